"""The live page of a robot: what it shows, the API behind it, and the server of both. It takes no commands."""
