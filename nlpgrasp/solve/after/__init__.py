"""What is worth knowing once all starts are done."""
