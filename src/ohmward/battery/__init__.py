"""Battery models, identification from tests, estimators of charge and health, the battery file."""
