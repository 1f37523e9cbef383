"""The process of one row: :func:`pnp_sci.bench.run` starts it, and reads the last line it prints."""

import json
import sys
from dataclasses import asdict

from .runner import measure

print(json.dumps(asdict(measure(**json.loads(sys.argv[1])))))
