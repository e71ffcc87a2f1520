# SPDX-License-Identifier: Apache-2.0
"""Runs the SCL of docs/plc/siemens: sources of TIA Portal with functions, function blocks, data blocks and data types.

Only what these files use. Every name must be declared, and types are checked as TIA Portal checks them without
implicit conversion: WORD has no arithmetic, UINT no bit operations, both sides of a comparison or an assignment have
one type. A value outside its type is an error, so nothing depends on how a CPU wraps. Anything unknown is an error with
its line."""
import os
import re
import time
from types import SimpleNamespace

from st_block import Ton

TOKEN = re.compile(r"\s+|//[^\n]*|\(\*.*?\*\)|\{[^}]*\}|(?P<time>T#\d+(?:MS|S))|(?P<hex>16#[0-9A-Fa-f]+)"
                   r"|(?P<num>\d+(?:\.\d+)?)|(?P<local>\#[A-Za-z_]\w*)|(?P<quoted>\"[^\"]+\")"
                   r"|(?P<id>[A-Za-z_]\w*)|(?P<bit>%X\d+)"
                   r"|(?P<op>:=|=>|<>|<=|>=|\.\.|[-+*/()\[\]=<>;:,.])", re.S)
RANGES = {"BOOL": (0, 1), "WORD": (0, 0xFFFF), "BYTE": (0, 0xFF), "DWORD": (0, 0xFFFFFFFF), "USINT": (0, 0xFF),
          "UINT": (0, 0xFFFF), "INT": (-0x8000, 0x7FFF), "UDINT": (0, 0xFFFFFFFF), "TIME": (0, 0x7FFFFFFF),
          "HW_ANY": (0, 0xFFFF), "CONN_OUC": (0, 0xFFFF), "CHAR": (0, 0xFF)}
NUMBERS = {"USINT", "UINT", "INT", "UDINT"}
BITS = {"BOOL", "BYTE", "WORD", "DWORD"}
LITERAL = "a literal"
TCON = {"InterfaceId": "HW_ANY", "ID": "CONN_OUC", "ConnectionType": "BYTE", "ActiveEstablished": "BOOL",
        "RemoteAddress": {"ADDR": ("ARRAY", 1, 4, "USINT")}, "RemotePort": "UINT", "LocalPort": "UINT"}


FOLDER = os.path.join(os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__)))), "docs/plc/siemens")


def siemens(clock=time.monotonic, instructions=None):
    """The blocks of docs/plc/siemens, in the order of their import."""
    return Library([os.path.join(FOLDER, name) for name in ("SLABD_TYPES.udt", "SLABD_DATA.db", "FB_SLABD.scl")], clock,
                   instructions)


def stored(value, kind):
    low, high = RANGES[kind]
    if not low <= value <= high:
        raise OverflowError(f"{value} is outside {kind}")
    return bool(value) if kind == "BOOL" else value


def converted(value, source, target):
    """Same bits, right-aligned; the value must fit."""
    if source == "WORD" and target == "INT":
        return value - 0x10000 if value & 0x8000 else value
    return stored(value, target)


class Library:
    """All blocks of some source files. `instructions`: classes for MB_CLIENT and MB_SERVER, which the tests provide."""

    def __init__(self, paths, clock=time.monotonic, instructions=None):
        self.clock, self.instructions = clock, instructions or {}
        self.types, self.blocks, self.data = {"TCON_IP_v4": TCON}, {}, {}
        for path in paths:
            with open(path, encoding="utf-8") as file:
                Source(self, path, file.read()).read()

    def blank(self, kind, initial=0):
        if isinstance(kind, dict):
            return SimpleNamespace(**{name: self.blank(member) for name, member in kind.items()})
        if isinstance(kind, tuple):
            _, low, high, element = kind
            return [None] * low + [self.blank(element) for _ in range(high - low + 1)]
        if kind in RANGES:
            return stored(initial, kind)
        if kind in self.types:
            return self.blank(self.types[kind])
        if kind == "TON_TIME":
            return Ton(self.clock)
        if kind in self.instructions:
            return self.instructions[kind]()
        return self.instance(kind)

    def instance(self, name):
        return Instance(self, self.blocks[name])

    def function(self, name, **arguments):
        """Calls a function; returns its instance, for the outputs."""
        block = Instance(self, self.blocks[name])
        block(**arguments)
        return block


class Instance:
    def __init__(self, library, block):
        self._block = block
        for name, (section, kind, initial) in block.variables.items():
            if kind != "STRING":
                setattr(self, name, library.blank(kind, initial))

    def __call__(self, **arguments):
        for name, value in arguments.items():
            section = self._block.variables[name][0]
            if section not in ("VAR_INPUT", "VAR_IN_OUT"):
                raise KeyError(name)
            setattr(self, name, value if section == "VAR_IN_OUT" else copied(value))
        self._block.body(self)


def copied(value):
    if isinstance(value, list):
        return [copied(element) for element in value]
    if isinstance(value, SimpleNamespace):
        return SimpleNamespace(**{name: copied(member) for name, member in vars(value).items()})
    return value


class Block:
    def __init__(self, name):
        self.name, self.variables, self.body = name, {}, None


class Source:
    def __init__(self, library, path, text):
        self.library, self.path, self.tokens, at = library, path, [], 0
        while at < len(text):
            match = TOKEN.match(text, at)
            if not match:
                raise SyntaxError(f"{path}:{text.count(chr(10), 0, at) + 1}: {text[at:at + 20]!r}")
            if match.lastgroup:
                self.tokens.append((match.lastgroup, match.group(), text.count("\n", 0, at) + 1))
            at = match.end()
        self.tokens.append(("end", "", 0))
        self.at, self.block, self.lines = 0, None, []

    def fail(self, what):
        raise SyntaxError(f"{self.path}:{self.tokens[self.at][2]}: {what}, at {self.tokens[self.at][1]!r}")

    def peek(self):
        return self.tokens[self.at][1]

    def take(self, expected=None):
        word = self.tokens[self.at][1]
        if expected is not None and word.upper() != expected.upper():
            self.fail(f"expected {expected}")
        self.at += 1
        return word

    # ---- blocks

    def read(self):
        while self.tokens[self.at][0] != "end":
            {"FUNCTION": self.function, "FUNCTION_BLOCK": self.function, "DATA_BLOCK": self.data_block,
             "TYPE": self.data_type}.get(self.peek(), lambda: self.fail("no block"))()

    def name(self):
        return self.take().strip('"')

    def version(self):
        self.take("VERSION"), self.take(":"), self.take()

    def data_type(self):
        self.take("TYPE")
        name = self.name()
        self.version()
        self.library.types[name] = self.struct()
        self.take("END_TYPE")

    def struct(self):
        members = {}
        self.take("STRUCT")
        while self.peek() != "END_STRUCT":
            name = self.name()
            self.take(":")
            members[name] = self.kind()
            self.take(";")
        self.take(), self.take(";")
        return members

    def data_block(self):
        self.take("DATA_BLOCK")
        name = self.name()
        self.version()
        self.take("NON_RETAIN")
        members = self.struct()
        self.take("BEGIN"), self.take("END_DATA_BLOCK")
        self.library.data[name] = (members, self.library.blank(members))

    def kind(self):
        word = self.take()
        if word.upper() != "ARRAY":
            kind = word.strip('"')
            known = kind.upper() in RANGES or kind.upper() == "STRING" or kind in self.library.types \
                or kind in self.library.blocks or kind == "TON_TIME" or kind in ("MB_CLIENT", "MB_SERVER")
            if not known:
                self.fail(f"type {kind}")
            return kind.upper() if kind.upper() in RANGES or kind.upper() == "STRING" else kind
        self.take("[")
        low = int(self.take())
        self.take("..")
        high = int(self.take())
        self.take("]"), self.take("of")
        return "ARRAY", low, high, self.kind()

    def function(self):
        end = {"FUNCTION": "END_FUNCTION", "FUNCTION_BLOCK": "END_FUNCTION_BLOCK"}[self.take()]
        self.block = block = Block(self.name())
        if end == "END_FUNCTION":
            self.take(":"), self.take("Void")
        self.version()
        while self.peek().startswith("VAR"):
            section = self.take()
            if self.peek() in ("CONSTANT", "RETAIN"):
                section += " " + self.take()
            while self.peek() != "END_VAR":
                name = self.name()
                self.take(":")
                kind, initial = self.kind(), 0
                if self.peek() == ":=":
                    self.take()
                    initial = self.literal()
                self.take(";")
                if name.lower() in (other.lower() for other in block.variables):
                    self.fail(f"{name} is declared twice")
                block.variables[name] = (section, kind, initial)
            self.take()
        self.take("BEGIN")
        self.lines = []
        self.statements(1, {end})
        self.take(end)
        space = {"stored": stored, "converted": converted, "data": {n: d for n, (_, d) in self.library.data.items()}}
        exec(compile("def body(s):\n" + "\n".join(self.lines), self.path, "exec"), space)  # text of this repository
        block.body = space["body"]
        self.library.blocks[block.name] = block

    def literal(self):
        kind, word, _ = self.tokens[self.at]
        self.at += 1
        if kind == "time":
            return int(re.search(r"\d+", word[2:]).group()) * (1 if word.endswith("MS") else 1000)
        return int(word[3:], 16) if kind == "hex" else int(word)

    # ---- statements

    def emit(self, depth, text):
        self.lines.append("  " * depth + text)

    def statements(self, depth, ends):
        first = len(self.lines)
        while self.peek() not in ends and not ("LABEL" in ends and self.label_ahead()):
            self.statement(depth)
        if len(self.lines) == first:
            self.emit(depth, "pass")

    def label_ahead(self):
        return self.tokens[self.at][0] == "local" and self.tokens[self.at + 1][1] == ":"

    def condition(self, end):
        text, kind = self.expression()
        if kind != "BOOL":
            self.fail("a condition must be BOOL")
        self.take(end)
        return text

    def statement(self, depth):
        word = self.peek()
        if word == "IF":
            self.take()
            self.emit(depth, f"if {self.condition('THEN')}:")
            self.statements(depth + 1, {"ELSIF", "ELSE", "END_IF"})
            while self.peek() == "ELSIF":
                self.take()
                self.emit(depth, f"elif {self.condition('THEN')}:")
                self.statements(depth + 1, {"ELSIF", "ELSE", "END_IF"})
            if self.peek() == "ELSE":
                self.take()
                self.emit(depth, "else:")
                self.statements(depth + 1, {"END_IF"})
            self.take("END_IF"), self.take(";")
        elif word == "FOR":
            self.take()
            name, _ = self.place()
            self.take(":=")
            low, _ = self.expression()
            self.take("TO")
            high, _ = self.expression()
            self.take("DO")
            self.emit(depth, f"for {name} in range({low}, {high} + 1):")
            self.statements(depth + 1, {"END_FOR"})
            self.take(), self.take(";")
        elif word == "CASE":
            self.take()
            self.emit(depth, f"_case = {self.expression()[0]}")
            self.take("OF")
            first = "if"
            while self.peek() != "END_CASE":
                label, _ = self.place()
                self.take(":")
                self.emit(depth, f"{first} _case == {label}:")
                first = "elif"
                self.statements(depth + 1, {"END_CASE", "LABEL"})
            self.take(), self.take(";")
        else:
            target, kind = self.place()
            if self.peek() == "(":
                self.call(depth, target, kind)
                return
            self.take(":=")
            value, source = self.expression()
            self.take(";")
            self.same(kind, source)
            self.emit(depth, f"{target} = stored({value}, {kind!r})")

    def call(self, depth, target, kind):
        arguments, outputs = [], []
        self.take("(")
        while True:
            name = self.take()
            if self.take() == "=>":
                outputs.append((self.place(), name))
            else:
                value, given = self.expression()
                arguments.append(f"{name}={value}")
                if kind in self.library.blocks:
                    section, wanted, _ = self.library.blocks[kind].variables[name]
                    if section not in ("VAR_INPUT", "VAR_IN_OUT"):
                        self.fail(f"{name} is not a parameter")
                    self.same(wanted, given)
            if self.take() == ")":
                break
        self.take(";")
        self.emit(depth, f"{target}({', '.join(arguments)})")
        for (place, wanted), name in outputs:
            self.emit(depth, f"{place} = stored({target}.{name}, {wanted!r})")

    def same(self, target, source):
        if source == LITERAL and (isinstance(target, tuple) or target == "BOOL"):
            self.fail(f"a number is not {target}")
        if source != LITERAL and target != source:
            self.fail(f"{source} is not {target}")

    # ---- expressions: (text of Python, type)

    def place(self):
        group, word, _ = self.tokens[self.at]
        self.at += 1
        if group == "local":
            if word[1:] not in self.block.variables:
                self.at -= 1
                self.fail("is not declared")
            section, kind, initial = self.block.variables[word[1:]]
            text = f"s.{word[1:]}" if section != "VAR CONSTANT" else str(initial)
        elif group == "quoted" and word.strip('"') in self.library.data:
            kind, text = self.library.data[word.strip('"')][0], f"data[{word}]"
        else:
            self.at -= 1
            self.fail("is not a variable")
        while self.peek() in ("[", "."):
            if self.take() == "[":
                index, number = self.expression()
                self.take("]")
                if kind == "STRING":
                    text, kind = f"ord({text}[{index} - 1])", "CHAR"
                    continue
                if not isinstance(kind, tuple) or number not in (LITERAL, *NUMBERS):
                    self.fail("not an array")
                text, kind = f"{text}[{index}]", kind[3]
                continue
            group, member, _ = self.tokens[self.at]
            self.at += 1
            if group == "bit":
                if kind != "WORD" or int(member[2:]) > 15:
                    self.fail("a bit of no WORD")
                text, kind = f"bool({text} >> {member[2:]} & 1)", "BOOL"
                continue
            member = member.strip('"')
            if isinstance(kind, dict) or kind in self.library.types:
                members = kind if isinstance(kind, dict) else self.library.types[kind]
                kind = members[member] if member in members else self.fail(f"no member {member}")
            elif kind in self.library.blocks and member in self.library.blocks[kind].variables:
                kind = self.library.blocks[kind].variables[member][1]
            else:
                self.fail(f"no member {member}")
            text += "." + member
        return text, kind

    def operand(self):
        group, word, _ = self.tokens[self.at]
        if word == "(":
            self.take()
            text, kind = self.expression()
            self.take(")")
            return f"({text})", kind
        if word == "NOT":
            self.take()
            text, kind = self.operand()
            self.same("BOOL", kind)
            return f"(not {text})", "BOOL"
        if group in ("num", "hex"):
            return str(self.literal()), LITERAL
        if group == "time":
            return str(self.literal()), "TIME"
        if word in ("TRUE", "FALSE"):
            self.take()
            return word.capitalize(), "BOOL"
        if group == "id":
            return self.built_in()
        return self.place()

    def built_in(self):
        name = self.take()
        self.take("(")
        if name in ("SHR", "SHL"):
            self.take("IN"), self.take(":=")
            text, kind = self.expression()
            self.take(","), self.take("N"), self.take(":=")
            count = self.literal()
            self.take(")")
            mask = RANGES[kind][1] if kind in ("WORD", "DWORD") else self.fail(f"{name} of {kind}")
            return f"(({text} {'>>' if name == 'SHR' else '<<'} {count}) & {mask})", kind
        text, kind = self.expression()
        self.take(")")
        if name == "LEN" and kind == "STRING":
            return f"len({text})", "INT"
        source, _, target = name.partition("_TO_")
        if source not in RANGES or target not in RANGES or source != kind:
            self.fail(f"{name} of {kind}")
        return f"converted({text}, {source!r}, {target!r})", target

    LEVELS = (("OR",), ("XOR",), ("AND",), ("=", "<>", "<", ">", "<=", ">="), ("+", "-"), ("*", "/", "MOD"))

    def expression(self, level=0):
        if level == len(self.LEVELS):
            return self.operand()
        left, kind = self.expression(level + 1)
        while self.peek() in self.LEVELS[level]:
            operator = self.take()
            right, other = self.expression(level + 1)
            both = kind if other == LITERAL else other
            if kind != LITERAL and other not in (LITERAL, kind):
                self.fail(f"{kind} {operator} {other}")
            if operator in ("AND", "OR", "XOR"):
                if both not in BITS:
                    self.fail(f"{operator} of {both}")
                word = {"AND": "and", "OR": "or", "XOR": "!="}[operator] if both == "BOOL" else \
                    {"AND": "&", "OR": "|", "XOR": "^"}[operator]
                left, kind = f"({left} {word} {right})", both
            elif level == 3:
                if operator not in ("=", "<>") and both not in NUMBERS:
                    self.fail(f"{operator} of {both}")
                left, kind = f"({left} {({'=': '==', '<>': '!='}).get(operator, operator)} {right})", "BOOL"
            else:
                if both not in NUMBERS and both != LITERAL:
                    self.fail(f"{operator} of {both}")
                left = f"({left} {({'/': '//', 'MOD': '%'}).get(operator, operator)} {right})"
                left, kind = (f"stored({left}, {both!r})", both) if both != LITERAL else (left, LITERAL)
        return left, kind
