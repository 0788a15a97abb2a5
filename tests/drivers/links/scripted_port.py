"""A serial port that answers by a script."""

import re

from drivers.links.serial_link import SerialLink


class Script:
    """Replies by question, used up one by one, the last for ever."""

    def __init__(self, replies):
        self.replies = replies

    def respond(self, line):
        answers = self.replies[line]
        return answers.pop(0) if len(answers) > 1 else answers[0]

    def refuse(self):
        pass


FENCE = ("WHO?", re.compile("me"))


def link_to(url, **more):
    settings = {"name": "probe", "baud": 9600, "timeout_s": 0.2, "retries": 1, "fences": [FENCE]}
    return SerialLink(url, **(settings | more))


def ask(link, question, **more):
    def exchange():
        link.send(question)
        return link.receive()

    return link.transact(question, exchange, **more)


class Flood:
    """Answers one question with a line that never ends."""

    def respond(self, line):
        return "x" * 70_000 if line == "A?" else "me"

    def refuse(self):
        pass
