"""URDF hands: file reader, kinematics and the hand itself."""
