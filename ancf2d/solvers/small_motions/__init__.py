"""Small motions about a state: modes, damping, responses, linear models, flutter."""
