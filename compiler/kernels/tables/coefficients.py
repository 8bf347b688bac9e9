"""Polynomials and constants of the kernels, one set a format.

Written by benchmarks/kernel_accuracy/fit_coefficients.py, which holds the definitions. P has its
coefficients from the constant on; z is the square of r or s.
"""

from __future__ import annotations

from compiler.kernels.tables.formats import DOUBLE, FLOAT, Format


def _read(texts: str) -> tuple[float, ...]:
    return tuple(float.fromhex(text) for text in texts.split())


def _read_words(texts: str) -> tuple[int, ...]:
    return tuple(int(text, 16) for text in texts.split())


# e^r = 1 + r + r²·P(r), |r| ≤ log(2) / 2
EXPONENTIAL: dict[Format, tuple[float, ...]] = {
    FLOAT: _read(
        "0x1.fffffc0000000p-2 0x1.55548c0000000p-3 0x1.55585a0000000p-5 0x1.123d5c0000000p-7 "
        "0x1.6ab6c00000000p-10"
    ),
    DOUBLE: _read(
        "0x1.000000000000ap-1 0x1.5555555555500p-3 0x1.55555555505f4p-5 0x1.1111111125a9ep-7 "
        "0x1.6c16c184bbd53p-10 0x1.a01a01385f82ap-13 0x1.a01998760747ep-16 "
        "0x1.71df002a8290cp-19 0x1.28aef55949d45p-22 0x1.adc31bbd06cbcp-26"
    ),
}

# log((1+s)/(1−s)) = 2s + s·z·P(z), (1+s)/(1−s) from 1/√2 to √2
LOGARITHM: dict[Format, tuple[float, ...]] = {
    FLOAT: _read(
        "0x1.5555540000000p-1 0x1.999c260000000p-2 0x1.23d3e00000000p-2 0x1.f13b1e0000000p-3"
    ),
    DOUBLE: _read(
        "0x1.5555555555593p-1 0x1.999999997f9f8p-2 0x1.249249422a464p-2 0x1.c71c51d7ce852p-3 "
        "0x1.746649afb4186p-3 0x1.39a09585cd199p-3 0x1.2f117fb8d8552p-3"
    ),
}

# the same as 2s + s·(2/3·z + z²·P(z)), 2/3 in two words: for powers
LOGARITHM_TAIL: dict[Format, tuple[float, ...]] = {
    FLOAT: _read(
        "0x1.9999980000000p-2 0x1.2493b60000000p-2 0x1.c63da80000000p-3 0x1.9084000000000p-3"
    ),
    DOUBLE: _read(
        "0x1.999999999999ap-2 0x1.2492492492363p-2 0x1.c71c71c747e9fp-3 0x1.745d172bc8e82p-3 "
        "0x1.3b13ba5a7780bp-3 0x1.110f1c3cdedb4p-3 0x1.e2657dd9500cap-4 0x1.a508e4c77f246p-4 "
        "0x1.eca2d4978d6e9p-4"
    ),
}

# sin r = r + r·z·P(z), |r| ≤ π/4
SINE: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("-0x1.5555460000000p-3 0x1.1107760000000p-7 -0x1.9952fa0000000p-13"),
    DOUBLE: _read(
        "-0x1.5555555555548p-3 0x1.111111110f730p-7 -0x1.a01a019be9211p-13 "
        "0x1.71de35552ab63p-19 -0x1.ae5e4b833b5a8p-26 0x1.5d8b5558870d1p-33"
    ),
}

# cos r = 1 − z/2 + z²·P(z), |r| ≤ π/4
COSINE: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.55554a0000000p-5 -0x1.6c0c1a0000000p-10 0x1.99e0ee0000000p-16"),
    DOUBLE: _read(
        "0x1.555555555554cp-5 -0x1.6c16c16c15217p-10 0x1.a01a019cbe0a2p-16 "
        "-0x1.27e4f8116c4a2p-22 0x1.1ee9f044e01acp-29 -0x1.8fb0916bddeb8p-37"
    ),
}

# tan r = r + r·z·P(z), |r| ≤ π/4
TANGENT: dict[Format, tuple[float, ...]] = {
    FLOAT: _read(
        "0x1.5555600000000p-2 0x1.110d9c0000000p-3 0x1.bada500000000p-5 0x1.5cb9b40000000p-6 "
        "0x1.62f58e0000000p-7 0x1.7e6ff60000000p-14 0x1.1ed0ca0000000p-8"
    ),
    DOUBLE: _read(
        "0x1.555555555555ep-2 0x1.11111111105d2p-3 0x1.ba1ba1babf349p-5 0x1.664f485d24bbbp-6 "
        "0x1.226e3a8181abep-7 0x1.d6d2e7aa4cfb9p-9 0x1.7db18f2dd99e5p-10 "
        "0x1.34bc18c38d515p-11 0x1.ff2ea221f575fp-13 0x1.5e7866969ea7bp-14 "
        "0x1.19f67f779694cp-14 -0x1.ae31a3af62f7cp-16 0x1.98115b39b8cf1p-15 "
        "-0x1.975a8e70f59b9p-16 0x1.48dc018dc51b3p-17"
    ),
}

# asin r = r + r·z·P(z), |r| ≤ 1/2
ARC_SINE: dict[Format, tuple[float, ...]] = {
    FLOAT: _read(
        "0x1.5555c80000000p-3 0x1.3301fc0000000p-4 0x1.747d060000000p-5 0x1.8c2d840000000p-6 "
        "0x1.596d600000000p-5"
    ),
    DOUBLE: _read(
        "0x1.5555555555577p-3 0x1.333333332e10bp-4 0x1.6db6db7215407p-5 0x1.f1c71a93982c6p-6 "
        "0x1.6e8bdf0cc0de7p-6 0x1.1c49ecdf1ee42p-6 0x1.ca1fe8bf2e9d3p-7 0x1.7582677d99d70p-7 "
        "0x1.614f338ec365fp-7 0x1.e4cc93e71f00cp-9 0x1.63fb0b50b2259p-6 -0x1.58890ee4a786cp-6 "
        "0x1.0b7412f9f39d0p-5"
    ),
}

# atan r = r + r·z·P(z), |r| ≤ 7/16
ARC_TANGENT: dict[Format, tuple[float, ...]] = {
    FLOAT: _read(
        "-0x1.5555420000000p-2 0x1.998df40000000p-3 -0x1.236ea80000000p-3 "
        "0x1.adcf6c0000000p-4 -0x1.dd15be0000000p-5"
    ),
    DOUBLE: _read(
        "-0x1.555555555550ap-2 0x1.999999998e5d4p-3 -0x1.2492491fe7805p-3 "
        "0x1.c71c6fd6f59f2p-4 -0x1.745cdb387e8aep-4 0x1.3b0f198e08b6cp-4 "
        "-0x1.10d5bb575236cp-4 0x1.ddda0dfcc38d6p-5 -0x1.9791b2c18e873p-5 "
        "0x1.2af5806695a00p-5 -0x1.0a3ac0d7f83edp-6"
    ),
}

# sinh r = r + r·z·P(z), |r| ≤ 1
HYPERBOLIC_SINE: dict[Format, tuple[float, ...]] = {
    FLOAT: _read(
        "0x1.5555560000000p-3 0x1.1110e00000000p-7 0x1.a022b60000000p-13 0x1.756df80000000p-19"
    ),
    DOUBLE: _read(
        "0x1.5555555555556p-3 0x1.111111111101ep-7 0x1.a01a01a037268p-13 "
        "0x1.71de3a3b06d8dp-19 0x1.ae646ff4ec572p-26 0x1.6116f4aeb2ddfp-33 "
        "0x1.b5c892a7af6dcp-41"
    ),
}

# tanh r = r + r·z·P(z), |r| ≤ 0.95 in float, ≤ 0.55 in double
HYPERBOLIC_TANGENT: dict[Format, tuple[float, ...]] = {
    FLOAT: _read(
        "-0x1.5555480000000p-2 0x1.110dfe0000000p-3 -0x1.b9a0bc0000000p-5 "
        "0x1.61b2ce0000000p-6 -0x1.0a0e960000000p-7 0x1.40aa7e0000000p-9 "
        "-0x1.a9803e0000000p-12"
    ),
    DOUBLE: _read(
        "-0x1.555555555549dp-2 0x1.11111111028b9p-3 -0x1.ba1ba1ad6881ep-5 "
        "0x1.664f45c131aaep-6 -0x1.226ddd1baa4eep-7 0x1.d6c6181d3e37bp-9 "
        "-0x1.7cf38633f6a1dp-10 0x1.2fa13eb8c14b3p-11 -0x1.b9013d8ff2ca7p-13 "
        "0x1.abe963b461576p-15"
    ),
}

# log(2) in two words, the first so short that products with exponents are exact
LN_2: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.62e4000000000p-1 0x1.7f7d1c0000000p-20"),
    DOUBLE: _read("0x1.62e42fefa3800p-1 0x1.ef35793c76730p-45"),
}

INVERSE_LN_2: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.7154760000000p+0"),
    DOUBLE: _read("0x1.71547652b82fep+0"),
}

# π/2 in two words
HALF_PI: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.921fb60000000p+0 -0x1.777a5c0000000p-25"),
    DOUBLE: _read("0x1.921fb54442d18p+0 0x1.1a62633145c07p-54"),
}

TWO_OVER_PI: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.45f3060000000p-1"),
    DOUBLE: _read("0x1.45f306dc9c883p-1"),
}

# π/2 in three words: products of the first two with quarter turns are exact
HALF_PI_PARTS: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.9220000000000p+0 -0x1.2aef000000000p-18 0x1.68c2340000000p-39"),
    DOUBLE: _read("0x1.921fb54442c00p+0 0x1.18469898cc400p-44 0x1.1701b839a2520p-88"),
}

# 2/3 in two words
TWO_THIRDS: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.5555560000000p-1 -0x1.5555560000000p-26"),
    DOUBLE: _read("0x1.5555555555555p-1 0x1.5555555555555p-55"),
}

# angles to which arguments of the arc tangent are reduced, in two words
ARC_TANGENT_HALF: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.dac6700000000p-2 0x1.586ed40000000p-28"),
    DOUBLE: _read("0x1.dac670561bb4fp-2 0x1.a2b7f222f65e2p-56"),
}

ARC_TANGENT_ONE: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.921fb60000000p-1 -0x1.777a5c0000000p-26"),
    DOUBLE: _read("0x1.921fb54442d18p-1 0x1.1a62633145c07p-55"),
}

ARC_TANGENT_THREE_HALVES: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.f730be0000000p-1 -0x1.afc12c0000000p-26"),
    DOUBLE: _read("0x1.f730bd281f69bp-1 0x1.007887af0cbbdp-56"),
}

# beyond the first e^x rounds to ∞, below the second to 0
EXPONENTIAL_LIMITS: dict[Format, tuple[float, ...]] = {
    FLOAT: _read("0x1.62e4300000000p+6 -0x1.9fe3680000000p+6"),
    DOUBLE: _read("0x1.62e42fefa39e7p+9 -0x1.74910d52d3052p+9"),
}

TWO_OVER_PI_WORDS: tuple[int, ...] = _read_words(
    "A2F9836E 4E441529 FC2757D1 F534DDC0 DB629599 3C439041 FE5163AB DEBBC561 B7246E3A "
    "424DD2E0 06492EEA 09D1921C FE1DEB1C B129A73E E88235F5 2EBB4484 E99C7026 B45F7E41 "
    "3991D639 835339F4 9C845F8B BDF9283B 1FF897FF DE05980F EF2F118B 5A0A6D1F 6D367ECF "
    "27CB09B7 4F463F66 9E5FEA2D 7527BAC7 EBE5F17B 3D0739F7 8A5292EA 6BFB5FB1 1F8D5D08 "
    "56033046"
)
"""The binary fraction of 2/π, 32 bits an entry."""
