"""The sensing operator against its formula, in every size, type and memory order; its adapters; its errors."""

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from operators_and_priors import OPERATORS
from scipy.sparse.linalg import lsqr

from pnp_sci import SensingOperator, SequenceOperator, adjoint_mismatch
from pnp_sci.errors import InputError, InputTypeError

DTYPES = ["bool", "uint8", "uint16", "int64", "float16", "float32", "float64", ">u2", ">f4", ">f8"]


@st.composite
def mask_stacks(draw):
    """(V, B, H, W) of any kind of real number, magnitudes from 1e-4 to 1e3."""
    shape = tuple(draw(st.integers(1, n)) for n in (3, 5, 5, 5))
    dtype = np.dtype(draw(st.sampled_from(DTYPES)))
    if dtype.kind == "f":
        elements = st.floats(-1000, 1000, width=16, allow_subnormal=False)
        return draw(arrays(np.float64, shape, elements=elements)).astype(dtype)
    most = {"b": 1, "u": 200, "i": 1000}[dtype.kind]
    return draw(arrays(np.int64, shape, elements=st.integers(-most if dtype.kind == "i" else 0, most))).astype(dtype)


def seeds():
    return st.integers(0, 2**32 - 1)


def video_and_picture(shape, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal(shape), rng.standard_normal(shape[2:])


@pytest.fixture(params=OPERATORS.values(), ids=OPERATORS.keys())
def masks(request):
    return request.param


@given(masks=mask_stacks(), seed=seeds())
def test_adjoint(masks, seed):
    """<Phi x, y> == <x, Phi^T y> to float precision, for any real masks."""
    assert adjoint_mismatch(SensingOperator(masks, np.float64), seed) < 1e-9


def test_adjoint_mismatch_sees_a_wrong_adjoint(masks):
    op = SensingOperator(masks, np.float64)
    right = op.adjoint
    op.adjoint = lambda y: 1.001 * right(y)
    assert adjoint_mismatch(op) > 1e-5


@given(masks=mask_stacks(), seed=seeds())
def test_linear(masks, seed):
    op = SensingOperator(masks, np.float64)
    (a, p), (b, q) = video_and_picture(op.shape, seed), video_and_picture(op.shape, seed + 1)
    np.testing.assert_allclose(op.forward(3 * a - b), 3 * op.forward(a) - op.forward(b), atol=1e-8)
    np.testing.assert_allclose(op.adjoint(3 * p - q), 3 * op.adjoint(p) - op.adjoint(q), atol=1e-8)


@given(masks=mask_stacks(), seed=seeds())
def test_views_are_interchangeable(masks, seed):
    views = np.random.default_rng(seed).permutation(len(masks))
    a, b = SensingOperator(masks, np.float64), SensingOperator(masks[views], np.float64)
    x, y = video_and_picture(a.shape, seed)
    np.testing.assert_allclose(b.forward(x[views]), a.forward(x), atol=1e-8)
    assert np.array_equal(b.adjoint(y), a.adjoint(y)[views])
    np.testing.assert_allclose(b.project(x[views], y, 0.1), a.project(x, y, 0.1)[views], atol=1e-8)


@given(masks=mask_stacks(), seed=seeds())
def test_projection_lands_on_the_measurement(masks, seed):
    """Phi z == y where any mask is open; where none is, x stays as it is."""
    op = SensingOperator(masks, np.float64)
    x, y = video_and_picture(op.shape, seed)
    z = op.project(x, y)
    alive = op.gram > 0
    scale = 1 + np.abs(masks.astype(float) * x).sum((0, 1))
    assert (np.abs(op.forward(z) - y)[alive] <= 1e-9 * scale[alive]).all()
    assert np.array_equal(z[..., ~alive], x[..., ~alive])


@given(masks=mask_stacks(), seed=seeds(), rho=st.floats(1e-3, 1e3))
def test_projection_is_the_minimiser(masks, seed, rho):
    """It solves the normal equations of ||y - Phi z||^2 + rho ||z - x||^2, written out as matrices for each pixel."""
    op = SensingOperator(masks, np.float64)
    x, y = video_and_picture(op.shape, seed)
    z = op.project(x, y, rho)
    for pixel in np.ndindex(y.shape):
        row = masks[(..., *pixel)].astype(float).ravel()
        right = row * y[pixel] + rho * x[(..., *pixel)].ravel()
        expected = np.linalg.solve(np.outer(row, row) + rho * np.eye(row.size), right)
        np.testing.assert_allclose(z[(..., *pixel)].ravel(), expected, rtol=1e-6, atol=1e-6)


@given(masks=mask_stacks(), seed=seeds(), power=st.integers(-8, 8), rho=st.sampled_from([0.0, 0.25]))
def test_scale_of_the_masks_cancels(masks, seed, power, rho):
    """Masks and y times c, rho times c^2: the same video, to the bit for powers of two."""
    c = 2.0**power
    x, y = video_and_picture(masks.shape, seed)
    a, b = SensingOperator(masks, np.float64), SensingOperator(masks.astype(float) * c, np.float64)
    assert np.array_equal(b.project(x, c * y, c**2 * rho), a.project(x, y, rho))
    assert np.array_equal(b.gram, c**2 * a.gram)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_formula(masks, dtype):
    op = SensingOperator(masks, dtype)
    x, y = (a.astype(dtype) for a in video_and_picture(op.shape))
    m = masks.astype(np.float64)
    gram = (m**2).sum((0, 1))
    rtol = 1e-5 if dtype == np.float32 else 1e-12
    for out, expected in (
        (op.forward(x), (m * x).sum((0, 1))),
        (op.adjoint(y), m * y),
        (op.gram, gram),
        (op.project(x, y, 0.5), x + m * ((y - (m * x).sum((0, 1))) / (gram + 0.5))),
    ):
        assert out.dtype == dtype
        np.testing.assert_allclose(out, expected, rtol=rtol, atol=rtol * (1 + np.abs(expected).max()))


@pytest.mark.parametrize("dtype", DTYPES)
def test_masks_of_any_dtype(dtype):
    masks = np.random.default_rng(0).integers(0, 2, (2, 3, 4, 5)).astype(dtype)
    op = SensingOperator(masks)
    x, _ = video_and_picture(op.shape)
    floating = np.float64 if dtype in ("float64", ">f8") else np.float32
    assert op.masks.dtype == (np.uint8 if dtype in ("bool", "uint8") else floating)
    assert op.dtype == floating
    np.testing.assert_allclose(op.forward(x), (masks.astype(float) * x).sum((0, 1)), rtol=1e-5, atol=1e-5)


def test_three_dimensions_are_one_view():
    masks = np.random.default_rng(0).random((3, 4, 5))
    assert SensingOperator(masks).shape == (1, 3, 4, 5)


@pytest.mark.parametrize("dtype", ["float32", "float64", "float16", "int32", "uint8", "bool", ">f4", ">f8"])
@pytest.mark.parametrize("order", ["fortran", "strided", "reversed", "moved"])
def test_memory_order_and_dtype_of_the_input(dtype, order):
    rng = np.random.default_rng(0)
    plain = [rng.integers(0, 2, shape).astype(dtype) for shape in ((2, 3, 4, 5), (2, 3, 4, 5), (4, 5))]
    same = {
        "fortran": np.asfortranarray,
        "strided": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
        "reversed": lambda a: np.ascontiguousarray(a[..., ::-1])[..., ::-1],
        "moved": lambda a: np.moveaxis(np.ascontiguousarray(np.moveaxis(a, -1, 0)), 0, -1),
    }[order]
    odd = [same(a) for a in plain]
    before = [a.copy() for a in odd]
    assert not any(a.flags.c_contiguous for a in odd)
    a, b = SensingOperator(plain[0]), SensingOperator(odd[0])
    assert np.array_equal(a.forward(plain[1]), b.forward(odd[1]))
    assert np.array_equal(a.adjoint(plain[2]), b.adjoint(odd[2]))
    assert np.array_equal(a.project(plain[1], plain[2], 0.1), b.project(odd[1], odd[2], 0.1))
    assert all(np.array_equal(p, q) for p, q in zip(odd, before))


@pytest.mark.threads
@pytest.mark.parametrize("shape", [(1, 1, 1, 1001), (1, 1, 1, 1_000_003), (2, 5, 61, 173)])
def test_parallel_kernels_agree_with_serial_ones(shape):
    """Pixels beyond the last whole block, for few and for many threads."""
    numba = pytest.importorskip("numba")
    rng = np.random.default_rng(0)
    op = SensingOperator(rng.random(shape) < 0.5)
    x, y = (a.astype(np.float32) for a in video_and_picture(shape))

    def all_four():
        return op.forward(x), op.adjoint(y), SensingOperator(op.masks).gram, op.project(x, y, 0.5)

    threads = numba.get_num_threads()
    many = all_four()
    try:
        numba.set_num_threads(1)
        one = all_four()
    finally:
        numba.set_num_threads(threads)
    for a, b in zip(many, one):
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(many[0], (op.masks * x.astype(float)).sum((0, 1)), rtol=1e-5, atol=1e-5)


def test_from_several_threads_at_once():
    shape = (2, 5, 64, 128)
    op = SensingOperator(np.random.default_rng(0).random(shape) < 0.5)
    x, y = (a.astype(np.float32) for a in video_and_picture(shape))
    expected = op.project(x, y)
    found = [None] * 4

    def work(n):
        for _ in range(5):
            found[n] = op.project(x, y)

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    for z in found:
        np.testing.assert_allclose(z, expected, rtol=1e-5, atol=1e-5)


def test_out(masks):
    op = SensingOperator(masks)
    x, y = (a.astype(op.dtype) for a in video_and_picture(op.shape))
    before = x.copy()
    for method, args in ((op.forward, (x,)), (op.adjoint, (y,)), (op.project, (x, y, 0.5))):
        plain = method(*args)
        out = np.full_like(plain, np.nan)
        assert method(*args, out=out) is out
        assert np.array_equal(out, plain)
    assert np.array_equal(x, before)
    expected = op.project(x, y)
    same_memory = before[:]
    op.project(before, y, out=same_memory)
    assert op.project(x, y, out=x) is x
    assert np.array_equal(x, expected)
    assert np.array_equal(same_memory, expected)


def test_scipy_finds_the_same_projection(masks):
    """LSQR, which knows the operator only as a LinearOperator, finds the smallest video that measures y."""
    op = SensingOperator(masks, np.float64)
    y = op.forward(video_and_picture(op.shape)[0])
    linear = op.linear_operator()
    assert linear.shape == (y.size, np.prod(op.shape))
    x = lsqr(linear, y.ravel(), atol=1e-13, btol=1e-13, iter_lim=500)[0]
    np.testing.assert_allclose(x.reshape(op.shape), op.project(np.zeros(op.shape), y), atol=1e-6 * np.abs(x).max())


NAN = np.ones((1, 2, 3, 4))
NAN[0, 1, 2, 3] = np.nan
OP = SensingOperator(np.ones((2, 3, 4, 5)))
X, Y = np.zeros((2, 3, 4, 5)), np.zeros((4, 5))


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: SensingOperator(np.ones((1, 2, 3, 4), complex)), InputTypeError, "masks.*complex128.*real"),
        (lambda: SensingOperator([[["a"]]]), InputTypeError, "masks.*<U1.*real"),
        (lambda: SensingOperator(np.ones((3, 4))), InputError, r"masks.*\(3, 4\).*views, frames, rows, columns"),
        (lambda: SensingOperator(np.ones((1, 0, 3, 4))), InputError, r"masks.*\(1, 0, 3, 4\).*none of them 0"),
        (lambda: SensingOperator(NAN), InputError, r"masks has 1 .*NaN.*\(0, 1, 2, 3\).*finite"),
        (lambda: SensingOperator(np.full((1, 1, 1, 1), 1e300), np.float32), InputError, "masks.*infinite.*float32"),
        (lambda: SensingOperator(X, np.int32), InputTypeError, "dtype is .*int32.*float32 or float64"),
        (lambda: SensingOperator(X, "single precision"), InputTypeError, "dtype is 'single precision'"),
        (lambda: SequenceOperator(OP), InputTypeError, "parts is SensingOperator.*a sequence of operators"),
        (lambda: OP.forward(X[:1]), InputError, r"x has shape \(1, 3, 4, 5\).*\(2, 3, 4, 5\) was expected"),
        (lambda: OP.forward(X + 0j), InputTypeError, "x has dtype complex128.*real"),
        (lambda: OP.adjoint(Y.T), InputError, r"y has shape \(5, 4\).*\(4, 5\) was expected"),
        (lambda: OP.project(X, Y.astype("U")), InputTypeError, "y has dtype.*real"),
        (lambda: OP.project(X, Y, -1), InputError, "rho is -1.*>= 0"),
        (lambda: OP.project(X, Y, np.nan), InputError, "rho is nan.*>= 0"),
        (lambda: OP.forward(X, out=np.zeros((5, 4))), InputError, r"out is float64 \(5, 4\).*float64 \(4, 5\)"),
        (lambda: OP.adjoint(Y, out=np.zeros(X.shape, "f4")), InputError, "out is float32.*float64"),
        (lambda: OP.forward(X, out=np.zeros((5, 4)).T), InputError, "out.*C-ordered"),
    ],
)
def test_errors_name_the_argument_what_came_and_what_was_expected(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_projection_with_a_weight_for_each_pixel():
    random = np.random.default_rng(0)
    op = SensingOperator(random.random((2, 3, 40, 50)))
    x, y = video_and_picture(op.shape)
    rho = random.random(op.shape[2:])
    expected = x + op.adjoint((y - op.forward(x)) / (op.gram + rho))
    assert op.project(x, y, rho) == pytest.approx(expected, abs=1e-12)
    assert np.array_equal(op.project(x, y, np.full_like(rho, 0.3)), op.project(x, y, 0.3))
    with pytest.raises(InputError, match="rho has shape"):
        op.project(x, y, rho[1:])
    with pytest.raises(InputError, match="rho is -1"):
        op.project(x, y, rho - 1 - rho)


def test_pixels_with_hardly_any_light_are_unlit():
    masks = np.ones((2, 3, 4, 5))
    masks[..., 0, :] = 0
    masks[..., 1, 2] = 0.01
    masks[..., 1, 3] = 0.1
    unlit = SensingOperator(masks).unlit
    assert unlit[0].all()
    assert unlit[1].tolist() == [False, False, True, False, False]
    assert not unlit[2:].any()
    assert SensingOperator(0 * masks).unlit.all()


def test_the_measurements_of_a_sequence_are_lit_each_for_itself():
    dim = np.ones((2, 1, 3, 8, 8))
    dim[1] *= 0.03
    dim[:, :, :, 0] *= 0.01
    op = SequenceOperator([SensingOperator(masks) for masks in dim])
    np.testing.assert_array_equal(op.unlit, [SensingOperator(masks).unlit for masks in dim])
    assert op.unlit[:, 0].all()
    assert not op.unlit[:, 1:].any()
