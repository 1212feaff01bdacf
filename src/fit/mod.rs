//! Stage III: observations go in, bodies with identity and joint angles come out. XNect §5.
