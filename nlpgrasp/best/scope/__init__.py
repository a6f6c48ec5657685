"""What of a problem a bound covers: which contact may be where, and which placements are images of others."""
