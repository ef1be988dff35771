"""The motion of one orbit step by step: flights, impacts, rests, and the record of them."""
