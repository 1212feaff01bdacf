//! Synthetic scenes: moving people with exact truth.
