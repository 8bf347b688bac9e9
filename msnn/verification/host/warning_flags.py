"""Warnings that generated C must not cause."""

GCC_WARNINGS = (
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wsign-conversion",
    "-Wdouble-promotion",
    # asked for, as generated code compares floats by < and > alone
    "-Wfloat-equal",
    "-Wshadow",
    "-Wstrict-prototypes",
    "-Wmissing-prototypes",
    "-Wold-style-definition",
    "-Wcast-qual",
    "-Wcast-align",
    "-Wundef",
    "-Wswitch-default",
    "-Wswitch-enum",
    "-Wvla",
    "-Wwrite-strings",
    "-Wlogical-op",
    "-Wduplicated-cond",
    "-Wnull-dereference",
    "-Wunused-macros",
    "-Wredundant-decls",
    "-Wpointer-arith",
    "-Wbad-function-cast",
    "-Wformat=2",
)

CLANG_WARNINGS = (
    "-Weverything",
    "-Wno-declaration-after-statement",  # a C90 rule
    "-Wno-padded",  # where double stands beside uint32_t
    "-Wno-unknown-warning-option",
    "-Wno-unsafe-buffer-usage",  # asks for C++ containers
    "-Wno-switch-default",
    "-Wno-pre-c11-compat",
)

CPP_WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow")
