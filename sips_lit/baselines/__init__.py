"""The detectors that SIPs is compared with, behind the same protocol, and controls that any detector should beat."""
