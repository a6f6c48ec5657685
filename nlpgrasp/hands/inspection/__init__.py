"""What a hand is before anything is solved with it: which fingertips meet, and what is to be known of its file."""
