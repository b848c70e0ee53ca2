"""Simulated batteries, missions and sensors, clearly named as simulated."""
