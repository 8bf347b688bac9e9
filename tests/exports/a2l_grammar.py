"""Reads ASAP2 strictly: only blocks that the generator may write, each with its whole grammar."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

_TOKEN = re.compile(
    r'\s+|/\*(?:(?!\*/).)*\*/|(?P<string>"(?:\\[\\"]|[^"\\\n])*")|(?P<word>[^\s"]+)', re.DOTALL
)
_IDENT = r"[A-Za-z_][A-Za-z0-9_]{0,127}(?:\.[A-Za-z_][A-Za-z0-9_]{0,127})*"
_FLOAT = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_TYPE = "FLOAT32_IEEE|FLOAT64_IEEE|SWORD|SLONG|A_INT64|ULONG"
_KINDS = {
    "string": r'"(?:\\[\\"]|[^"\\])*"',
    "ident": _IDENT,
    "float": _FLOAT,
    "uint": r"\d+",
    "int": r"-?\d+",
    "hex": r"0x[0-9A-F]+",
    "type": _TYPE,
}
# What stands in a block behind its keyword, then the keywords that may follow with what they take.
_BLOCKS: dict[str, tuple[str, dict[str, str]]] = {
    "PROJECT": ("ident string", {}),
    "MODULE": ("ident string", {}),
    "MOD_PAR": ("string", {"VERSION": "string", "EPK": "string", "ADDR_EPK": "hex"}),
    "MEMORY_SEGMENT": (
        "ident string =DATA =RAM =INTERN hex hex int int int int int",
        {},
    ),
    "MOD_COMMON": ("string", {"BYTE_ORDER": "=MSB_LAST|MSB_FIRST"}),
    "RECORD_LAYOUT": ("ident", {"FNC_VALUES": "uint type =ROW_DIR|COLUMN_DIR =DIRECT"}),
    "COMPU_METHOD": (
        "ident string =IDENTICAL|LINEAR string string",
        {"COEFFS_LINEAR": "float float"},
    ),
    "CHARACTERISTIC": (
        "ident string =VALUE|VAL_BLK|CURVE|MAP hex ident float ident float float",
        {"MATRIX_DIM": "uint uint uint", "SYMBOL_LINK": "string uint"},
    ),
    "AXIS_DESCR": ("=FIX_AXIS ident ident uint float float", {}),
    "FIX_AXIS_PAR_LIST": ("float*", {}),
    "MEASUREMENT": (
        "ident string type ident uint float float float",
        {
            "ECU_ADDRESS": "hex",
            "MATRIX_DIM": "uint uint uint",
            "LAYOUT": "=ROW_DIR",
            "SYMBOL_LINK": "string uint",
        },
    ),
    "GROUP": ("ident string", {"ROOT": ""}),
    "REF_CHARACTERISTIC": ("ident*", {}),
    "REF_MEASUREMENT": ("ident*", {}),
}
_INSIDE = {
    "": {"PROJECT"},
    "PROJECT": {"MODULE"},
    "MODULE": {
        "MOD_PAR",
        "MOD_COMMON",
        "RECORD_LAYOUT",
        "COMPU_METHOD",
        "CHARACTERISTIC",
        "MEASUREMENT",
        "GROUP",
    },
    "MOD_PAR": {"MEMORY_SEGMENT"},
    "CHARACTERISTIC": {"AXIS_DESCR"},
    "AXIS_DESCR": {"FIX_AXIS_PAR_LIST"},
    "GROUP": {"REF_CHARACTERISTIC", "REF_MEASUREMENT"},
}


@dataclass
class Block:
    """A block: what stands behind its keyword, its keywords, its blocks."""

    kind: str
    values: list[str] = field(default_factory=list[str])
    keywords: dict[str, list[str]] = field(default_factory=dict[str, list[str]])
    blocks: list[Block] = field(default_factory=list["Block"])

    @property
    def name(self) -> str:
        return self.values[0]

    def of(self, *kinds: str) -> list[Block]:
        return [block for block in self.blocks if block.kind in kinds]


def read_a2l(text: str) -> Block:
    """The module of a file; AssertionError where anything is not the grammar."""
    assert text.isascii()
    tokens = list(_tokens(text))
    assert tokens[:3] == ["ASAP2_VERSION", "1", "71"]
    root = Block("")
    rest = _read(root, tokens[3:])
    assert not rest
    (project,) = root.blocks
    (module,) = project.blocks
    _check_names(module)
    return module


def string(token: str) -> str:
    """The text that a string stands for."""
    return re.sub(r"\\(.)", r"\1", token[1:-1])


def _tokens(text: str) -> Iterator[str]:
    at = 0
    while at < len(text):
        found = _TOKEN.match(text, at)
        assert found, text[at : at + 60]
        at = found.end()
        if found["string"] or found["word"]:
            yield found[0]


def _read(parent: Block, tokens: list[str]) -> list[str]:
    while tokens and tokens[0] == "/begin":
        kind = tokens[1]
        assert kind in _INSIDE.get(parent.kind, ()), f"{kind} in {parent.kind}"
        block = Block(kind)
        parent.blocks.append(block)
        fixed, optional = _BLOCKS[kind]
        block.values, tokens = _take(fixed, tokens[2:])
        while tokens[:2] != ["/end", kind]:
            if tokens[0] == "/begin":
                tokens = _read(block, tokens)
                continue
            keyword = tokens[0]
            assert keyword in optional, f"{keyword} in {kind}"
            assert keyword not in block.keywords
            block.keywords[keyword], tokens = _take(optional[keyword], tokens[1:])
        tokens = tokens[2:]
    return tokens


def _take(grammar: str, tokens: list[str]) -> tuple[list[str], list[str]]:
    taken: list[str] = []
    for part in grammar.split():
        pattern = part[1:] if part.startswith("=") else _KINDS[part.removesuffix("*")]
        if part.endswith("*"):
            while re.fullmatch(pattern, tokens[0]):
                taken.append(tokens[0])
                tokens = tokens[1:]
        else:
            assert re.fullmatch(pattern, tokens[0]), f"{tokens[0]} for {part}"
            taken.append(tokens[0])
            tokens = tokens[1:]
    return taken, tokens


def _check_names(module: Block) -> None:
    """Names are different, what is named is there, and lower limits are below upper ones."""
    objects = module.of("CHARACTERISTIC", "MEASUREMENT")
    names = [block.name for block in module.of("CHARACTERISTIC", "MEASUREMENT")]
    methods = [block.name for block in module.of("COMPU_METHOD")]
    layouts = [block.name for block in module.of("RECORD_LAYOUT")]
    for listed in (names, methods, layouts, [block.name for block in module.of("GROUP")]):
        assert len(set(listed)) == len(listed)
    grouped = [n for g in module.of("GROUP") for block in g.blocks for n in block.values]
    assert grouped == names
    for block in objects:
        low, high = (float(value) for value in block.values[-2:])
        assert low <= high
        if block.kind == "CHARACTERISTIC":
            assert block.values[4] in layouts
            assert block.values[6] in methods
            axes = {"VALUE": 0, "VAL_BLK": 0, "CURVE": 1, "MAP": 2}[block.values[2]]
            assert len(block.blocks) == axes
        else:
            assert block.values[3] in methods
            assert "ECU_ADDRESS" in block.keywords
        for axis in block.blocks:
            assert axis.values[1] in (*names, "NO_INPUT_QUANTITY")
            assert axis.values[2] in methods
            knots = [float(value) for value in axis.blocks[0].values]
            assert len(knots) == int(axis.values[3])
            assert knots == sorted(set(knots))
