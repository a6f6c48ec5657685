"""What is kept on disk beside whole files: locks, JSON that is read strictly."""
