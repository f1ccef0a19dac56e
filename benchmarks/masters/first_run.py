"""Time the start of a process that runs ten steps; `masters.extras` starts it and reads its times.

The arguments are the paths of two FMUs, their inputs and outputs, names joined by commas, and the connections
(``left.x,right.u``); an FMU has the name of its file.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

begin = time.perf_counter()
from co_sim import Connection, FmuComponent, Master, System  # noqa: E402

imported = time.perf_counter()
path_a, path_b, u_a, y_a, u_b, y_b, *connections = sys.argv[1:]
components = {
    Path(path).stem: FmuComponent(path, inputs=u.split(","), outputs=y.split(","))
    for path, u, y in ((path_a, u_a, y_a), (path_b, u_b, y_b))
}
system = System(components, [Connection(*connection.split(",")) for connection in connections])
with Master(system) as master:
    master.start()
    started = time.perf_counter()
    master.run(n_steps=10)
    ended = time.perf_counter()
times = {"import": imported - begin, "build and start": started - imported, "first steps": ended - started}
print(json.dumps(times))
