"""The form of messages to users."""

import re

# A message says what is wrong with the input, or what it must be.
_FAULT = re.compile(
    r"\b(found|missing|unknown|empty|damaged|incomplete|cannot|not|no|only|but|needed|likely|must|may|more|less|give)\b"
)


def is_sentence(message: str) -> bool:
    """True if a message is one line of several words that says what is wrong, without the name of an exception class.

    The names of classes in brackets are those of a library that refused a file.
    """
    outside = re.sub(r"\(.*\)", "", message)
    words = len(message.split()) > 2
    return words and "\n" not in message and bool(_FAULT.search(message)) and not re.search(r"\w+Error\b", outside)
