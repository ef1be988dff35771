from .attractor_table import rows as rows
from .class_changes import Change as Change
from .class_changes import Label as Label
from .class_changes import changes as changes
from .class_changes import labels as labels
from .distinct_attractors import attractors as attractors
from .motion import Motion as Motion
from .motion import classify as classify
