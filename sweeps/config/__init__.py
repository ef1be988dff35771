"""From a YAML file to a checked `SweepConfig`, with errors that name the line and the key.

``values.py`` has the forms of a value, ``schema.py`` the groups of keys, ``sweep.py`` all of them
with the checks across groups, of which ``steps.py`` has those of the steps per period and
``refine_checks.py`` those of a refinement. ``loading.py`` has the YAML, ``messages.py`` the errors,
``names.py`` what people type instead of a key, ``scenes.py`` the scenes that come with the program.
"""
