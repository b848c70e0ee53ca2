"""Speed and slip from encoders, motor currents and an IMU by a Kalman filter; see docs/traction-observers.md."""
