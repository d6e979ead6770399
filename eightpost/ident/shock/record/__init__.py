"""What of the records is fitted: segment, low-pass, runs, and how a lag acts on them."""
