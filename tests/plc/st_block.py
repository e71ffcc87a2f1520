# SPDX-License-Identifier: Apache-2.0
"""Runs a function block written in IEC 61131-3 Structured Text, so that the text integrators copy is the text under test.

Only what docs/plc uses: one FUNCTION_BLOCK; BOOL, UINT, UDINT, TON and one-dimensional arrays of them; IF, CASE, FOR,
assignments, calls with named arguments, bit access. The text is turned into Python once; integers wrap as the standard's
do. Anything else is an error with its line."""
import re
import time

TOKEN = re.compile(r"\s+|\(\*.*?\*\)|(?P<time>T#\d+(?:MS|S))|(?P<hex>16#[0-9A-Fa-f]+)|(?P<num>\d+)|(?P<id>[A-Za-z_]\w*)"
                   r"|(?P<op>:=|<>|<=|>=|\.\.|[-+*/()\[\]=<>;:,.])", re.S)
WORDS = {"AND": "and", "OR": "or", "NOT": "not", "MOD": "%", "TRUE": "True", "FALSE": "False"}
OPS = {"=": "==", "<>": "!=", "/": "//"}
LIMITS = {"UINT": 0xFFFF, "UDINT": 0xFFFFFFFF}


class Ton:
    """The standard's on-delay timer."""

    def __init__(self, clock):
        self._clock, self._since, self.Q = clock, None, False

    def __call__(self, IN, PT):
        if not IN:
            self._since, self.Q = None, False
            return
        if self._since is None:
            self._since = self._clock()
        self.Q = (self._clock() - self._since) * 1000 >= PT


class Translator:
    def __init__(self, text):
        self.tokens, at = [], 0
        while at < len(text):
            match = TOKEN.match(text, at)
            if not match:
                raise SyntaxError(f"line {text.count(chr(10), 0, at) + 1}: {text[at:at + 20]!r}")
            if match.lastgroup:
                self.tokens.append((match.lastgroup, match.group(), text.count("\n", 0, at) + 1))
            at = match.end()
        self.at, self.types, self.initial, self.lines = 0, {}, {}, []

    def peek(self):
        return self.tokens[self.at][1]

    def take(self, expected=None):
        _, word, line = self.tokens[self.at]
        if expected is not None and word != expected:
            raise SyntaxError(f"line {line}: expected {expected!r}, found {word!r}")
        self.at += 1
        return word

    # ---- declarations

    def block(self):
        self.take("FUNCTION_BLOCK")
        self.name = self.take()
        while self.peek().startswith("VAR"):
            self.take()
            if self.peek() == "CONSTANT":
                self.take()
            while self.peek() != "END_VAR":
                self.declaration()
            self.take()
        self.statements(1, {"END_FUNCTION_BLOCK"})
        return self

    def declaration(self):
        name = self.take()
        self.take(":")
        kind, count = self.take(), None
        if kind == "ARRAY":
            self.take("["), self.take("0"), self.take("..")
            count = int(self.take()) + 1
            self.take("]"), self.take("OF")
            kind = self.take()
        if kind not in ("BOOL", "UINT", "UDINT", "TON"):
            raise SyntaxError(f"{name}: type {kind}")
        self.types[name] = (kind, count)
        if self.peek() == ":=":
            self.take()
            self.initial[name] = int(self.take())
        self.take(";")

    # ---- statements

    def emit(self, depth, text):
        self.lines.append("  " * depth + text)

    def statements(self, depth, ends):
        empty = True
        while self.peek() not in ends:
            empty = False
            self.statement(depth)
            if ends == {"LABEL"} and self.label_ahead():
                break
        if empty:
            self.emit(depth, "pass")

    def label_ahead(self):
        return self.peek() == "END_CASE" or self.tokens[self.at + 1][1] == ":"

    def statement(self, depth):
        word = self.peek()
        if word == "IF":
            self.take()
            self.emit(depth, f"if {self.expression({'THEN'})}:")
            self.take()
            self.statements(depth + 1, {"ELSIF", "ELSE", "END_IF"})
            while self.peek() == "ELSIF":
                self.take()
                self.emit(depth, f"elif {self.expression({'THEN'})}:")
                self.take()
                self.statements(depth + 1, {"ELSIF", "ELSE", "END_IF"})
            if self.peek() == "ELSE":
                self.take()
                self.emit(depth, "else:")
                self.statements(depth + 1, {"END_IF"})
            self.take("END_IF"), self.take(";")
        elif word == "FOR":
            self.take()
            name = self.take()
            self.take(":=")
            low = self.expression({"TO"})
            self.take()
            high = self.expression({"DO"})
            self.take()
            self.emit(depth, f"for s.{name} in range({low}, {high} + 1):")
            self.statements(depth + 1, {"END_FOR"})
            self.take(), self.take(";")
        elif word == "CASE":
            self.take()
            self.emit(depth, f"_case = {self.expression({'OF'})}")
            self.take()
            first = "if"
            while self.peek() != "END_CASE":
                label = self.take()
                self.take(":")
                self.emit(depth, f"{first} _case == s.{label}:")
                first = "elif"
                self.statements(depth + 1, {"LABEL"})
            self.take(), self.take(";")
        else:
            self.assignment_or_call(depth)

    def assignment_or_call(self, depth):
        name = self.peek()
        if self.tokens[self.at + 1][1] == "(":
            self.take(), self.take("(")
            arguments = []
            while True:
                key = self.take()
                self.take(":=")
                arguments.append(f"{key}={self.expression({',', ')'})}")
                if self.take() == ")":
                    break
            self.take(";")
            self.emit(depth, f"s.{name}({', '.join(arguments)})")
            return
        target = self.primary()
        self.take(":=")
        value = self.expression({";"})
        self.take()
        kind = self.types[name][0]
        limit = LIMITS.get(kind)
        self.emit(depth, f"{target} = ({value}) & {limit}" if limit else f"{target} = bool({value})")

    # ---- expressions

    def primary(self):
        name = self.take()
        if self.peek() == "(":  # a conversion
            self.take()
            inner = self.expression({")"})
            self.take()
            if not re.fullmatch(r"U?D?INT_TO_U?D?INT", name):
                raise SyntaxError(f"function {name}")
            return f"(({inner}) & {LIMITS[name.split('_TO_')[1]]})"
        if name not in self.types:
            raise SyntaxError(f"line {self.tokens[self.at - 1][2]}: {name} is not declared")
        text = f"s.{name}"
        if self.peek() == "[":
            self.take()
            text += f"[{self.expression({']'})}]"
            self.take()
        if self.peek() == ".":
            self.take()
            member = self.take()
            text = f"bool({text} >> {member} & 1)" if member.isdigit() else f"{text}.{member}"
        return text

    def expression(self, ends):
        parts, depth = [], 0
        while depth or self.peek() not in ends:
            kind, word, _ = self.tokens[self.at]
            if kind == "id" and word not in WORDS:
                parts.append(self.primary())
                continue
            self.take()
            depth += (word == "(") - (word == ")")
            if kind == "time":
                parts.append(str(int(re.search(r"\d+", word[2:]).group()) * (1 if word.endswith("MS") else 1000)))
            elif kind == "hex":
                parts.append("0x" + word[3:])
            else:
                parts.append(WORDS.get(word, OPS.get(word, word)))
        return " ".join(parts)


class Block:
    """An instance: its variables are attributes; calling it is one cycle."""

    def __init__(self, path, clock=time.monotonic):
        with open(path, encoding="utf-8") as file:
            translated = Translator(file.read()).block()
        self.types = translated.types
        for name, (kind, count) in translated.types.items():
            def blank():
                return Ton(clock) if kind == "TON" else kind == "_" if kind == "BOOL" else 0
            setattr(self, name, translated.initial.get(name, blank() if count is None else [blank()] * count))
        code = {}
        exec(compile("def body(s):\n" + "\n".join(translated.lines), path, "exec"), code)  # text of this repository
        self._body = code["body"]

    def __call__(self, **inputs):
        for name, value in inputs.items():
            if name not in self.types:
                raise KeyError(name)
            setattr(self, name, value)
        self._body(self)
