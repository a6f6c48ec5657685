"""Display utilities: drawings, pages, formatted numbers and wrenches, warnings."""
