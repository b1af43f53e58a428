# SPDX-License-Identifier: BSD-2-Clause
"""Former names of attributes and arguments: they work for one version, with a warning."""

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from .errors import InputError, warn_caller

_Function = TypeVar("_Function", bound=Callable[..., Any])


class FormerName:
    """An attribute under its former name: the attribute `name`, with a `DeprecationWarning`."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._former = ""

    def __set_name__(self, owner: type, former: str) -> None:
        self._former = former

    def __get__(self, instance: object, owner: type) -> Any:
        if instance is None:  # as a property, so that tools can list the class
            return self
        warn_caller(f"{owner.__name__}.{self._former} is now {self._name}", DeprecationWarning)
        return getattr(instance, self._name)


def former_arguments(**names: str) -> Callable[[_Function], _Function]:
    """Decorator of a function whose arguments were renamed: former name = name."""

    def decorated(function: _Function) -> _Function:
        @wraps(function)
        def renamed(*args: Any, **arguments: Any) -> Any:
            for former, name in names.items():
                if former not in arguments:
                    continue
                if name in arguments:
                    problem = f"this is the former name of {name}=; use {name}= alone"
                    raise InputError(former, problem)
                warn_caller(f"{former}= is now {name}=", DeprecationWarning)
                arguments[name] = arguments.pop(former)
            return function(*args, **arguments)

        return renamed  # type: ignore[return-value]  # it has the signature of `function`

    return decorated
