"""YAML to a checked `SweepConfig`, with the line of every key.

``values.py`` defines the forms of a value, ``points.py`` the table of points, ``groups.py`` the
groups of keys, each key checked on its own, ``rig.py`` the group of a rig, and ``sweep.py`` the
whole configuration, with the `Sweep` that it computes. ``loading.py`` reads the YAML; ``checks.py``
checks keys together, and completes the defaults that depend on several of them. ``messages.py``
writes the errors and knows synonyms of the keys, ``json_schema.py`` makes the schema for editors,
and ``scenes.py`` reads the scenes that come with the program.
"""
