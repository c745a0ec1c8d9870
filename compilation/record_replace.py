"""`record._replace(field=value)` in compiled code, for every NamedTuple; numba does not support it.

The method is typed with one parameter per field; parameters that a call leaves out have the type none.
"""

from inspect import Parameter, Signature
from typing import Any

from numba.core import imputils, types
from numba.core.errors import TypingError
from numba.core.typing import templates
from numba.extending import lower_builtin

_KEY = "record._replace"


class _Replace(templates.AbstractTemplate):  # type: ignore[misc]  # numba carries no types
    key = _KEY
    this: Any

    def generic(self, args: Any, kws: Any) -> Any:
        """The signature of a call: each named field has the type that it has in the record."""
        fields = self.this.fields
        if args or not kws.keys() <= set(fields):
            raise TypingError(f"_replace: got {', '.join(kws)}, wanted some of {', '.join(fields)}")
        kinds = zip(fields, self.this.types, strict=True)
        given = [kind if name in kws else types.none for name, kind in kinds]
        parameters = [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD, default=None) for name in fields]
        found = templates.signature(self.this, *given, recvr=self.this)
        return found.replace(pysig=Signature(parameters))


@templates.infer_getattr
class _Record(templates.AttributeTemplate):  # type: ignore[misc]  # numba carries no types
    key = types.BaseNamedTuple

    def resolve__replace(self, record: Any) -> Any:
        """The method itself."""
        return types.BoundFunction(_Replace, record)


@lower_builtin(_KEY, types.BaseNamedTuple, types.VarArg(types.Any))
def _replaced(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    record, *values = args
    for index, (kind, value) in enumerate(zip(sig.args[1:], values, strict=True)):
        if kind is not types.none:
            record = builder.insert_value(record, value, index)
    return imputils.impl_ret_borrowed(context, builder, sig.return_type, record)
