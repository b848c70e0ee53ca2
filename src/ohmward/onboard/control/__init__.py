"""Slip control on board: estimates and an operator's set-points in, torques or wheel speeds out; see docs/drive.md."""
