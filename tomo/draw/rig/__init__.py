"""Pictures and pages of camera rigs."""
