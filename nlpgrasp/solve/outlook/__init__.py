"""What can be known of all placements before a start: a bound on mu, and good places to start from."""
