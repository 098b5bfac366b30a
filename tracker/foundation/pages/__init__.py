"""Self-contained pages: reports and comparisons fill their own templates, which share one look."""

from __future__ import annotations

from collections.abc import Mapping

import jinja2


def filled(package: str, template: str, content: Mapping[str, object]) -> str:
    """A page as HTML; its content is escaped.

    Args:
        package: of the template, for instance `tracker.results.recording`; it may extend `page.html`, which has head
            and style.
        template: its path there.
        content: values of its names.
    """
    loaders = [jinja2.PackageLoader(package, "."), jinja2.PackageLoader("tracker.foundation.pages", ".")]
    environment = jinja2.Environment(loader=jinja2.ChoiceLoader(loaders), autoescape=True)
    return environment.get_template(template).render(content)
