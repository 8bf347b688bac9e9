"""One named constructor for each diagnostic code, one file for each range of codes.

A constructor takes facts and writes the sentence; its docstring starts with its code. To add one,
take the next free number of the range and write it in that range's file:

    E01xx YAML text: `yaml_text`        E06xx time and windows
    E02xx schema: `schema`              E07xx states and loops: `states`, sub-models: `submodels`
    E03xx names and expressions         E08xx data files
        E0301-E0319 names               E09xx training, validation, export
        E0320-E0399 `expressions`       E10xx command line, files, extras: `files`
    E04xx shapes
    E05xx units: `units`                    E11xx optimal control: `control`

Warnings have the same ranges and start with W.
"""
