"""bodytrack: model-based, marker-less motion capture from calibrated views.

Nouns are the files of this package, verbs its folders; see the README's architecture section.
"""

__version__ = "0.1.0"
