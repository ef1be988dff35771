"""From a YAML file to a checked `SweepConfig`, with errors that name the line and the key.

``values.py`` defines the forms of a value, ``points.py`` the table of points, ``groups.py`` the
groups of keys, ``rig.py`` the group of a rig, ``sweep.py`` the whole configuration, and
``checks.py`` the checks that involve several groups. ``loading.py`` reads the YAML, ``messages.py``
writes the errors and knows synonyms of the keys, ``json_schema.py`` makes the schema for editors,
and ``scenes.py`` reads the scenes that come with the program.
"""
