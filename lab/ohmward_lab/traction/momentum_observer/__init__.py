"""Speed and slip from momentum at 1 kHz, without a friction law; see docs/traction-observers.md."""
