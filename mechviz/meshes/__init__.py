"""Solid meshes of mechanisms: links, guides, wheels, belts, cylinders, pins and ground, in layers that do not collide.

```python
solids = build_solids(mechanism, poses)
solids.links["crank"].mesh        # trimesh, watertight, metres, in the link's own frame
```
"""

from mechviz.meshes.heights import Heights
from mechviz.meshes.solids import Solid, Solids, build_solids, stl_bytes

__all__ = ["Heights", "Solid", "Solids", "build_solids", "stl_bytes"]
