"""Laboratory of ohmward: simulation, assessment, reproduction of publications, and methods that only studies use.

It imports ohmward; nothing in ohmward imports it. Commands, the simulated source of `ohmward run` and the estimators
that reproduce a publication are loaded by name.
"""
