"""The C++ reference, from the headers of include/splatvol/: each class, function and contract.

The headers are in one style (.clang-format; contracts begin with ///), so lines and brackets tell where a declaration
begins and ends. What is not understood is shown as it stands, in the code of its class.
"""

import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

ORDER = ("file", "renderer", "build", "scene", "transfer_function", "image", "geometry", "surface_depths", "device", "error")
LEFT_OUT = ("export",)  # a macro that users do not see


@dataclass
class Declaration:
    contract: list = field(default_factory=list)  # of lines
    code: list = field(default_factory=list)

    @property
    def text(self) -> str:
        return "\n".join(self.code).replace("SPLATVOL_EXPORT ", "").replace("[[nodiscard]] ", "")

    @property
    def head(self) -> str:
        return " ".join(line.split("//")[0].strip() for line in self.code)


def without_trailing(line: str) -> str:
    return re.sub(r"\s*//.*", "", line)


def declarations(lines: list) -> list:
    """Splits lines of one depth into declarations, each with the comment above it."""
    found, current, depth = [], Declaration(), 0
    for line in lines:
        stripped = line.strip()
        if not current.code and not stripped:
            if current.contract:  # a comment that belongs to nothing: of what follows
                current.contract.append("")
            continue
        if not current.code and stripped.startswith("//"):
            current.contract.append(stripped.lstrip("/").removeprefix(" "))
            continue
        current.code.append(line)
        code = without_trailing(line)
        depth += sum(code.count(c) for c in "{([") - sum(code.count(c) for c in "})]")
        ended = code.rstrip().endswith((";", "}", ":")) and depth == 0
        if ended or stripped.startswith("#"):
            found.append(current)
            current = Declaration()
    if current.code:
        found.append(current)
    return found


def parts_of_class(declaration: Declaration) -> list:
    """The public declarations in a class or struct."""
    begin = next(i for i, line in enumerate(declaration.code) if without_trailing(line).rstrip().endswith("{"))
    inner, public = [], declaration.head.startswith("struct")
    for line in declaration.code[begin + 1 : -1]:
        access = re.fullmatch(r"\s*(public|private|protected):", line)
        if access:
            public = access[1] == "public"
        elif public:
            inner.append(line.removeprefix("  "))
    return declarations(inner)


def name_of(head: str) -> str:
    match = re.match(r"(?:class|struct|enum class|enum|using|inline constexpr \S+|constexpr \S+)\s+(?:SPLATVOL_EXPORT\s+)?(\w+)", head)
    return match[1] if match else ""


def function_of(head: str) -> str:
    """The name of a function that is declared; empty if it is none."""
    head = re.sub(r"\[\[\w+\]\]|SPLATVOL_EXPORT", "", head)
    if not re.search(r"\)\s*(const|noexcept|= default|= delete|override|\s)*(;|\{)", head) or "=" in head.split("(")[0]:
        return ""
    match = re.search(r"(operator\S+|~?\w+)\s*\(", head)
    return match[1] if match and not head.startswith(("using", "struct", "class", "enum", "static_assert")) else ""


def is_plumbing(head: str) -> bool:
    """Moves and destructors, which every class here has."""
    return bool(re.match(r"(~\w+\(\)|\w+\(\w+&&\)|\w+& operator=\(\w+&&\))", head.strip()))


def signature(declaration: Declaration) -> list:
    """Of a function with a body in the header: what comes before the body."""
    text = declaration.text
    if function_of(declaration.head) and re.search(r"\)\s*(const|noexcept|\s)*\{", text):
        text = re.sub(r"(\)\s*(?:const|noexcept|\s)*?)\s*\{.*", r"\1;", text, flags=re.DOTALL)
    return ["```cpp", text, "```", ""]


def prose(contract: list) -> list:
    while contract and not contract[-1]:
        contract = contract[:-1]
    # Words in angle brackets would be taken for HTML.
    return [re.sub(r"(?<!`)<(\w)", r"&lt;\1", line) for line in contract] + [""]


def class_lines(declaration: Declaration, name: str) -> list:
    fields, functions = [], []
    for part in parts_of_class(declaration):
        if is_plumbing(part.head):
            continue
        if function_of(part.head) and "operator==" not in part.head:
            functions.append(part)
        else:
            fields += [f"// {line}".rstrip() for line in prose(part.contract)[:-1]] + part.text.split("\n")
    lines = prose(declaration.contract)
    if fields:
        lines += ["```cpp", declaration.text.split("\n")[0]] + [f"  {line}".rstrip() for line in fields] + ["};", "```", ""]
    for function in functions:
        lines += [f"#### {name}::{function_of(function.head)}", ""] if function.contract else []
        lines += signature(function) + prose(function.contract)
    return lines


def page_of_header(path: Path) -> list:
    text = path.read_text()
    about, _, body = text.partition("#pragma once")
    about = [line.lstrip("/").removeprefix(" ") for line in about.strip().split("\n")]
    body = body[body.find("namespace splatvol {") + len("namespace splatvol {") : body.rfind("}  // namespace splatvol")]
    lines = [f"## splatvol/{path.name}", ""] + prose(about)
    for declaration in declarations(body.split("\n")):
        head = declaration.head
        name = name_of(head)
        if head.startswith(("class", "struct")) and "{" in head:
            lines += [f"### {name}", ""] + class_lines(declaration, name)
        elif name or function_of(head):
            if declaration.contract or head.startswith("enum"):
                lines += [f"### {name or function_of(head)}", ""]
            lines += signature(declaration) + prose(declaration.contract)
        elif not head.startswith("static_assert"):
            lines += signature(declaration) + prose(declaration.contract)
    return lines


def complete(text: str, headers: Path) -> str:
    """Appends the headers to the page that was written by hand."""
    names = [path.stem for path in headers.glob("*.h") if path.stem not in LEFT_OUT]
    if not names:
        sys.exit(f"{headers}: no headers")
    lines = []
    for name in sorted(names, key=lambda name: (ORDER.index(name) if name in ORDER else len(ORDER), name)):
        lines += page_of_header(headers / f"{name}.h")
    return text.rstrip("\n") + "\n\n" + re.sub(r"\n{3,}", "\n\n", "\n".join(lines)) + "\n"
