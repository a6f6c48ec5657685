"""Which contacts, and how many: problems that differ in their contacts, solved with each other's grasps."""
