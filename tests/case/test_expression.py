"""The expression language: values, exact derivatives, and no other code."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ancf2d.case import Expression
from ancf2d.case.programs import state_programs, value_at
from ancf2d.case.syntax import MAX_LENGTH, ExpressionError, Names, formula, syntax
from ancf2d.errors import ComputationError


@pytest.mark.parametrize(("text", "t", "value"), [
    ("1", 0, 1), ("t", 3, 3), ("pi", 0, math.pi), ("-t^2", 3, -9), ("2^3^2", 0, 512),
    ("2^-1", 0, 0.5), ("(-2)^3", 0, -8), ("1 - 2 - 3", 0, -4), ("8/4/2", 0, 1), ("2+3*4", 0, 14),
    ("-2*-3", 0, 6), ("--2", 0, 2), ("+-2", 0, -2), ("2*(3+4)", 0, 14), (".5e1", 0, 5),
    ("sin(pi/2)", 0, 1), ("cos(0)", 0, 1), ("exp(1)", 0, math.e), ("sqrt(16)", 0, 4),
    ("abs(-3)", 0, 3), ("t < 1", 0.5, 1), ("t < 1", 1, 0), ("t <= 1", 1, 1), ("t >= 1", 1, 1),
    ("t == 1", 1, 1), ("t != 1", 1, 0), ("0 < t < 1", 0.5, 1), ("0 < t < 1", 2, 0),
    ("3 > 2 > 1", 0, 1), ("(t < 1)*5", 0, 5), ("1 if t < 1 else 2", 0, 1),
    ("1 if t < 1 else 2", 1, 2), ("1 if t<1 else 2 if t<2 else 3", 1.5, 2),
    ("1 if t<1 else 2 if t<2 else 3", 2, 3), ("1/t if t > 0 else 0", 0, 0),
    ("2*(1 if t > 0 else 3)", 0, 6), ("0^0", 0, 1)])
def test_value(text, t, value):
    assert Expression(text).value(t) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(("text", "t", "rate"), [
    ("1", 2, 0), ("t", 2, 1), ("t^2", 3, 6), ("t^3", -2, 12), ("2^t", 1, 2 * math.log(2)),
    ("t^t", 2, 4 * (math.log(2) + 1)), ("(-t)^3", 2, -12), ("1/t", 2, -0.25),
    ("t*t*t", 2, 12), ("sin(3*t)", 0.2, 3 * math.cos(0.6)), ("cos(t)^2", 0.3, -math.sin(0.6)),
    ("exp(-2*t)", 0.5, -2 * math.exp(-1)), ("sqrt(t)", 4, 0.25), ("abs(t)", -2, -1),
    ("abs(t)", 0, 1), ("abs(-2*t)", 0, 2), ("t^2 if t < 1 else 2*t - 1", 0.5, 1), ("t^2 if t < 1 else 2*t - 1", 3, 2),
    ("t < 1", 0.5, 0), ("-t", 1, -1), ("t - 2*t", 1, -1), ("t/(1 + t)", 1, 0.25),
    ("6/15*(t^2/2 + (15/(2*pi))^2*(cos(2*pi*t/15) - 1))", 5,
     6 / 15 * (5 - 15 / (2 * math.pi) * math.sin(2 * math.pi / 3)))])
def test_rate_is_the_derivative(text, t, rate):
    assert Expression(text).rate(t) == pytest.approx(rate, rel=1e-13, abs=1e-15)
    assert Expression(text, scale=-2).rate(t) == pytest.approx(-2 * rate, rel=1e-13, abs=1e-15)


@pytest.mark.parametrize(("text", "column", "words"), [
    ("", 0, "ends too early"), ("   ", 0, "ends too early"), ("1 +", 3, "ends too early"),
    ("tan(t)", 0, "'tan' is unknown"), ("x", 0, "known names are t, pi, sin"),
    ("2*(t + 1", 8, r"'\)' is missing"), ("2*t)", 3, r"'\)' is unexpected"),
    ("t t", 2, "'t' is unexpected"), ("2t", 1, "'t' is unexpected"), ("t**2", 1, "written \\^"),
    ("sin t", 4, r"'\(' is missing after sin"), ("sin()", 4, "'\\)' is unexpected"),
    ("sin(t, 2)", 5, "',' is not allowed; functions have one argument"), ("1 if t", 6, "'else' is missing"),
    ("1 if t > 1 and t < 2 else 0", 11, "'and' is unexpected; for both conditions, multiply them"),
    ("(t > 1) | (t < 0)", 8, "'|' is not allowed; for one of two conditions, add them"),
    ("if t", 0, "a value is missing"), ("t = 2", 2, "'=' is not allowed"), ("a.b", 0, "'a.b' is unknown"),
    ("t > 1 and t < 2", 6, r"'and' is unexpected; .* \(t > 1\)\*\(t < 2\)"),
    ("1 if (t < 1 or t > 2) else 0", 12, r"'or' is unexpected; .* \(t < 1\) \+ \(t > 2\)"),
    ("'t'", 0, "not allowed"), ("1e999", 0, "too large"),
    ("__import__", 0, "unknown"), ("t[0]", 1, "not allowed"), ("1 if 1 else", 11, "too early"),
    ("½", 0, "not allowed"), ("t;t", 1, "not allowed"), ("lambda", 0, "unknown"),
    ("2 *\n* 3", 4, "unexpected")])
def test_errors_say_where(text, column, words):
    with pytest.raises(ExpressionError, match=words) as caught:
        syntax(text)
    assert caught.value.column == column


@pytest.mark.parametrize(("text", "columns"), [
    ("x + 2*y + x", [0, 6]), ("tan(x) + log(t)", [0, 4, 9]), ("(x", [1, 2]), ("x + sin t", [0, 8]),
    ("t + x if y else z", [4, 9, 16])])
def test_all_unknown_names_are_found_at_once(text, columns):
    with pytest.raises(ExpressionError) as caught:
        syntax(text)
    assert [one.column for one in caught.value.each] == columns


@pytest.mark.parametrize(("names", "what"), [
    (Names("t", {"t": 1.0}), "parameter"), (Names("t", {}, ("t",)), "controller or state"),
    (Names("s", {"x": 1.0}, ("x",)), "parameter")])
def test_names_have_one_meaning(names, what):
    text = "x" if names.variable == "s" else "t"
    with pytest.raises(ExpressionError, match=f"'{text}' has a meaning of its own here; give the {what} another name"):
        syntax(f"2*{text}", names)


@pytest.mark.parametrize("text", [
    "(" * 1000, "-" * 1999 + "t", "2^" * 900 + "t", "1 if t else " * 160 + "1",
    "sin(" * 400, "t" * (MAX_LENGTH + 1), "(" * 100 + "t" + ")" * 100])
def test_work_is_bounded(text):
    reason = ""
    try:
        assert math.isfinite(Expression(text).value(1.0))
    except ExpressionError as error:
        reason = str(error)
    assert not reason or "deep" in reason or "longer" in reason


def test_long_sums_are_fine():
    assert Expression("+".join(["t"] * 999)).value(1.0) == 999


@pytest.mark.parametrize(("text", "t", "words"), [
    ("1/t", 0, "divides by zero"), ("exp(t)", 1000, "too large"), ("sqrt(t)", -1, "not real"),
    ("t^0.5", -1, "not real"), ("0^t", -1, "not real|divides by zero"),
    ("10^200*10^200", 0, "too large"), ("10^t", 400, "too large")])
def test_no_value(text, t, words):
    with pytest.raises(ComputationError, match=words) as caught:
        Expression(text).value(t)
    assert text in str(caught.value)
    assert f"t = {t:g}" in str(caught.value)
    assert caught.value.failure.at == {"t": t}


def test_no_rate():
    with pytest.raises(ComputationError, match=r"no rate at t = 0"):
        Expression("sqrt(t)").rate(0)


ATOMS = st.sampled_from(["t", "pi", "2", "0.5", "3"])


def grow(inner):
    return st.one_of(
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda p: f"({p[0]} {p[1]} {p[2]})"),
        st.tuples(st.sampled_from(["sin", "cos", "abs"]), inner).map(lambda p: f"{p[0]}({p[1]})"),
        st.tuples(inner, st.integers(0, 3)).map(lambda p: f"({p[0]})^{p[1]}"),
        st.tuples(inner, inner, inner).map(lambda p: f"({p[0]} if {p[1]} < {p[2]} else {p[0]})"),
        inner.map(lambda p: f"(-{p})"))


@given(st.recursive(ATOMS, grow, max_leaves=8), st.floats(-3, 3))
@settings(derandomize=True, deadline=None, max_examples=150)
def test_value_as_python_computes_it(text, t):
    names = {"t": t, "pi": math.pi, "sin": math.sin, "cos": math.cos, "abs": abs}
    try:
        reference = float(eval(text.replace("^", "**"), {"__builtins__": {}}, names))
    except (ZeroDivisionError, OverflowError):
        with pytest.raises(ComputationError):
            Expression(text).value(t)
        return
    if math.isfinite(reference):
        assert Expression(text).value(t) == pytest.approx(reference, rel=1e-12, abs=1e-300)


@given(st.text(alphabet="t pi0123456789.e+-*/^()<>=!sincoexprtqabfl\n_,'\"[]{}", max_size=40))
@settings(derandomize=True, deadline=None, max_examples=200)
def test_any_text_is_an_expression_or_refused(text):
    column = 0
    try:
        syntax(text)
    except ExpressionError as error:
        column = error.column
    assert 0 <= column <= len(text)


@pytest.mark.parametrize("text", ["a*b + t", "a/b - b^2", "sin(a*b)^2 + exp(-b)", "sqrt(a^2 + b^2)", "abs(-a)*b",
                                  "a if a < b else b^a", "k*a^3", "(0 < a < b)*a", "-(a - b)*cos(t)"])
def test_gradients_are_derivatives(text):
    """By quantities, against differences."""
    tree = syntax(formula(text, Names("t", {"k": 3.0}, ("a", "b"))))
    program = state_programs([(tree, 2.0)], {"a": 0, "b": 1}, 2)
    at, step = [0.7, 1.3], 1e-6
    _, gradient = value_at(program, 0, 0.4, at)
    for i in range(2):
        plus, minus = ([x + s * step * (k == i) for k, x in enumerate(at)] for s in (1, -1))
        rate = (value_at(program, 0, 0.4, plus)[0] - value_at(program, 0, 0.4, minus)[0]) / (2 * step)
        assert gradient[i] == pytest.approx(rate, rel=1e-8, abs=1e-9)


def test_each_function_has_the_gradient_by_its_own_quantities():
    """Each uses some of five, in another order."""
    names = {name: k for k, name in enumerate("abcde")}
    trees = [syntax(formula(text, Names("t", {}, tuple(names)))) for text in ("d*b^2", "1 + t", "c/a - b", "e*e")]
    program = state_programs([(tree, 1.0) for tree in trees], names, 5)
    a, b, c, d, e = at = [2.0, 3.0, 5.0, 7.0, 11.0]
    found = [value_at(program, k, 0.5, at) for k in range(4)]
    assert found == [(d * b * b, [0, 2 * b * d, 0, b * b, 0]), (1.5, [0] * 5),
                     (c / a - b, [-c / a**2, -1, 1 / a, 0, 0]), (e * e, [0, 0, 0, 0, 2 * e])]


def test_equal_formulas_have_equal_parameters():
    one, same, other = (formula("k*t", Names("t", {"k": k, "m": m})) for k, m in ((1, 2), (1, 3), (2, 2)))
    assert one == same
    assert one != other
    assert Expression(one).value(2.0) == 2.0
    assert Expression(other).value(2.0) == 4.0
    assert formula("2*t", Names("t", {"k": 1})) == "2*t"
