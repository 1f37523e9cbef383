"""The process that measures one row: :func:`pnp_sci.bench.run` starts it and reads the last line that it prints."""

import json
import sys
from dataclasses import asdict

from pnp_sci.bench.cases import Case
from pnp_sci.bench.methods import Method
from pnp_sci.bench.runner import measure

request = json.loads(sys.argv[1])
print(json.dumps(asdict(measure(Case(**request["case"]), Method(**request["method"]), request["repeat"]))))
