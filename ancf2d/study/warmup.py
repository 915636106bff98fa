"""Compiling before timing: the first run of a kind of model pays for its kernels, and says so."""

from __future__ import annotations

import numpy as np

from ..model.model import Model


def warm_up(model: Model) -> None:
    """Compile (or load from the cache) the kernels that a model's solve will call, on empty work."""
    from ..kernels.elements import force, force_tangent, tangent_action
    from ..solve.linear import make_matrix

    num = model.numbering
    matrix = make_matrix(model)
    d = np.zeros(len(num.place))
    for group in model.groups:
        none = group._replace(dofs=group.dofs[:0], cls=group.cls[:0])
        force_tangent(none, d, d, d, matrix.target, num.place, num.indptr, num.index, num.value)
        force(none, d, d)
        if model.moves or type(model.case.solver).__name__ == "LinearStatic":
            tangent_action(none, d, d, d)
