"""Whole programs for people in photos and films, ours and other people's: what a millisecond of processor buys."""
