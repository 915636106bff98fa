"""``python -m ancf2d`` is the command ``ancf2d``."""

from .cli import main

if __name__ == "__main__":
    main()
