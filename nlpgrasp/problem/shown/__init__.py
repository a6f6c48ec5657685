"""Display of grasp problems as text, HTML page and notebook card."""
