"""Evidence about ffsi (`python -m studies`): published and exact values, costs, the paper's study.

The words around its tables are a template in `documents/`. Each study is a function `main`. It takes `jobs`, runs at a
time; `out`, the folder of its tables and figures; `readme`, the file of whose blocks it replaces its own, unless a run
failed; `runs`, where run folders stay, from which a second call goes on. It returns the failures of all runs, as
`Result.failure`, empty strings where all is well. It raises InputError before anything is computed where an argument
cannot be used, later where a run folder cannot be, SceneError for a level that is none, and FreeFEMNotFound; so does
what it calls.
"""
