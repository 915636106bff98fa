"""Measurements of motions for docs/motion.md, one module for each part."""
