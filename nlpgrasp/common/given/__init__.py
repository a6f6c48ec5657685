"""What users state in several ways: lengths in units, angles, poses."""
