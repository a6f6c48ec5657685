"""Robot descriptions as plain data: links, joints and shapes of a URDF or MJCF."""
