"""A stage that nobody looks at: what viser would show, taken note of."""

from __future__ import annotations

import contextlib


class Node:
    """What viser would show, as it was told."""

    def __init__(self, *arguments: object, **told: object) -> None:
        self.arguments, self.value, self.on = arguments, None, []
        vars(self).update(told)

    def on_update(self, call):
        self.on.append(call)

    on_click = on_update

    def __enter__(self):
        return self

    def __exit__(self, *fault: object) -> None:
        """What is added inside of a folder is found as what is outside."""


class Server:
    """Takes note of nodes and of what steers them; nothing is served."""

    def __init__(self) -> None:
        self.nodes, self.gui, self.scene, self.atomic = {}, self, self, contextlib.nullcontext
        self.initial_camera = Node()

    def __getattr__(self, name: str):
        if not name.startswith("add_"):
            raise AttributeError(name)

        def add(what, *arguments, **told):
            self.nodes[what if isinstance(what, str) else name] = node = Node(*arguments, **told)
            if name == "add_slider":
                node.min, node.max, node.step, node.value = arguments
            if name == "add_checkbox":
                node.value = arguments[0]
            return node

        return add
