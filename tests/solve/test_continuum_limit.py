"""The family [p, q] converges to the plane-stress continuum if supports and loads are spread over the section."""

import helpers
import numpy as np
import pytest

SQUARE = {"height": 0.1, "width": 0.1}


def beam(p: int, q: int, count: int, h: float = 0.1):
    spec = {"type": "ancf", "order": [p, q], "count": count, "formulation": "continuum"}
    return {"beam": helpers.body(helpers.line(2.0), spec, {"height": h, "width": 0.1}, helpers.STEEL)}


def supported(p: int, q: int, count: int, loads: list, h: float = 0.1, spread: str | None = "parabolic"):
    more = {"spread": spread} if spread else {}
    return helpers.solved(
        beam(p, q, count, h),
        "linear_static",
        loads=loads,
        bc=[{"type": "pin", "at": "beam@0", **more}, {"type": "roller", "at": "beam@1", "fixed": "y", **more}],
    )


@pytest.mark.parametrize("order", [(3, 3), (4, 4)])
def test_midspan_of_table_1s_beam_under_a_parabolic_load(order):
    """Continuum 0.097394 mm; geometrically exact beams stay at 0.0973575 (k) and 0.0973720 (5/6)."""
    load = [{"type": "force", "at": "beam@0.5", "value": [0, -1000], "spread": "parabolic"}]
    out = supported(*order, 8, load)
    assert 1e3 * out.u("beam@0.5")[1] == pytest.approx(-0.097394, abs=2e-6)


def test_point_forces_and_supports_on_the_axis_creep_with_the_order():
    load = [{"type": "force", "at": "beam@0.5", "value": [0, -1000]}]
    values = [1e3 * supported(p, p, 8, load, spread=None).u("beam@0.5")[1] for p in (3, 4, 5)]
    assert values[0] > values[1] > values[2]
    assert abs(values[2] - values[1]) > 3e-7


@pytest.mark.parametrize("count", [8, 16])
def test_tip_of_table_2s_beam_with_a_breathing_clamp(count):
    """Continuum (-0.14506, -0.68113): the clamp fixes the plain mean of the section."""
    out = helpers.solved(
        beam(3, 3, count),
        bc=[{"type": "clamp", "at": "beam@0", "hold": "breathe"}],
        loads=helpers.tip(0, -500e3, spread="parabolic"),
    )
    np.testing.assert_allclose(out.u("beam@1"), [-0.14506, -0.68113], atol=5e-6)


def test_a_full_clamp_is_stiffer_by_half_a_per_mille():
    out = helpers.solved(
        beam(3, 3, 8), bc=[{"type": "clamp", "at": "beam@0", "hold": "all"}],
        loads=helpers.tip(0, -500e3, spread="parabolic")
    )
    np.testing.assert_allclose(out.u("beam@1"), [-0.14489, -0.6807], atol=2e-4)


def test_p_refinement_is_exponential_under_own_weight():
    """Supports at the parabolic mean give a smooth solution: the energy's error falls by a factor per order."""
    weight = [{"type": "gravity", "value": [0, -9.81]}]
    exact = supported(8, 5, 8, weight, 0.4).state.energy
    errors = [abs(supported(p, min(p, 5), 2, weight, 0.4).state.energy / exact - 1) for p in range(1, 7)]
    for p, error in enumerate(errors, start=1):
        assert error < 20 * 10 ** (-1.4 * p)


def test_with_q_3_the_section_warps_by_itself():
    """Its shear factor is 1: Timoshenko's k would count the warping twice (0.09753 mm)."""
    load = [{"type": "force", "at": "beam@0.5", "value": [0, -1000], "spread": "parabolic"}]
    bodies = beam(3, 3, 8)
    bodies["beam"]["element"]["shear_factor"] = "timoshenko"
    spread = {"spread": "parabolic"}
    out = helpers.solved(
        bodies,
        "linear_static",
        loads=load,
        bc=[{"type": "pin", "at": "beam@0", **spread}, {"type": "roller", "at": "beam@1", "fixed": "y", **spread}],
    )
    assert 1e3 * out.u("beam@0.5")[1] == pytest.approx(-0.09753, abs=1e-5)
