"""The same networks in other people's engines, measured beside ours in one run."""
