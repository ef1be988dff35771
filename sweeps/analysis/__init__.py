"""What the recorded motions are: period class, kind of motion, changes, attractors."""
