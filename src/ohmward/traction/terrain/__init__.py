"""Slip on learnt floors: from the forces of the wheels to their slip, and crossings between floors."""
