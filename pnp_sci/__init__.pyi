from .operator import SensingOperator as SensingOperator
from .operator import adjoint_mismatch as adjoint_mismatch
