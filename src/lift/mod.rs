//! Stage II: detections go in, observations (full 3D per person) come out. XNect §4.2.
