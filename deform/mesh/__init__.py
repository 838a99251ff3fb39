"""Wall maps and centrelines in, 3-D surfaces out; Open3D is imported here and nowhere else, and only when called."""

from deform.mesh.write import write_dent_surfaces as write_dent_surfaces
from deform.mesh.write import write_zone_shells as write_zone_shells
