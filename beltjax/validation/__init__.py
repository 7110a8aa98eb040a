"""The dissertation's tables and figures made again, each printed number beside the computed one.

`python -m beltjax.validation --out DIR` writes them all. L. Kong, *Coupled belt-pulley
mechanics in serpentine belt drives*, dissertation, The Ohio State University, 2003.
"""
