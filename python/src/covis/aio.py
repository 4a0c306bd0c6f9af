"""The asyncio twins: the same names as in `covis`, whose calls are awaited.

```
async with await covis.aio.connect(url) as client:
    async with await client.ingest("map", "robot") as session:
        await session.camera(0, 640, 480, K)
```
"""

from ._client import Client
from ._connect import connect, local
from ._map import Map
from ._session import Session

__all__ = ["Client", "Map", "Session", "connect", "local"]
