"""The trial log: what happened, as data; statistics that say how sure they are; pictures and a film of it."""
