"""What a file claims beside its rows: quality and its evidence, how the solve ended, torques, the drawing."""
