"""What makes and checks the measured and generated parts of the documents; run as ``python -m scripts.NAME``."""
