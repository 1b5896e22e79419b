#!/usr/bin/env python3
"""Finds circles of imports (product files that name items of each other, directly or through others), and long files.

    tests/imports/check.py [ROOT]

File A depends on file B of the same crate if A names an item that B defines, by `use` or by path, tests aside. A parent
that only declares or re-exports a child does not depend on it. Exits with 1 if there is one, and prints them
with the names that close them, or if a file has more than 600 lines without its tests. Checks first that it finds the
circle of an example.
"""

import pathlib
import re
import sys
import tempfile

# Lines of a product file, without its tests.
MAX_LINES = 600

CRATES = ("core", "firmware", "scene", "plan", "client", "remote", "sim", "pictures", "serve", "paper", "host", "py")
ITEM = re.compile(
    r"^\s*(?:pub(?:\([^)]*\))?\s+)?(?:(?:const|async|unsafe|extern \"C\")\s+)*"
    r"(?:fn|struct|enum|union|trait|const|static|type|macro_rules!)\s+(?:mut\s+)?([A-Za-z_]\w*)",
    re.M,
)
USE = re.compile(r"^\s*(pub(?:\([^)]*\))?\s+)?use\s+([^;]+);", re.M)
PATH = re.compile(r"(?<![\w:])((?:crate|super|self|[a-z_]\w*)(?:::[A-Za-z_]\w*)+)")


def without_comments_and_texts(code: str) -> str:
    """Replaces comments and string literals, so that braces and paths in them do not count."""
    pattern = r'//[^\n]*|/\*.*?\*/|r(#*)".*?"\1|b?"(?:[^"\\]|\\.)*"|b?\'(?:[^\'\\\n]|\\[^\n]{1,8}?)\''
    return re.sub(pattern, lambda found: "\n" * found[0].count("\n") + '""', code, flags=re.S)


def without_tests(code: str) -> str:
    """Removes each item behind `#[cfg(test)]`."""
    while (start := re.search(r"#\[cfg\((?:test|all\(test[^]]*)\)\]", code)) is not None:
        at, depth = start.end(), 0
        while at < len(code):
            if code[at] in "{([":
                depth += 1
            elif code[at] in "})]":
                depth -= 1
                if depth == 0 and code[at] == "}":
                    break
            elif code[at] == ";" and depth == 0:
                break
            at += 1
        code = code[: start.start()] + code[at + 1 :]
    return code


def leaves(tree: str, prefix: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], str]]:
    """The paths of a `use`, each with the name that it brings into the file."""
    tree = tree.strip()
    if tree.endswith("}"):
        head, inner = tree[:-1].split("{", 1)
        path = prefix + tuple(part.strip() for part in head.split("::") if part.strip())
        parts, depth, begun = [], 0, 0
        for at, char in enumerate(inner):
            depth += (char == "{") - (char == "}")
            if char == "," and depth == 0:
                parts.append(inner[begun:at])
                begun = at + 1
        return [leaf for part in [*parts, inner[begun:]] if part.strip() for leaf in leaves(part, path)]
    path_text, _, alias = tree.partition(" as ")
    path = prefix + tuple(part.strip() for part in path_text.split("::") if part.strip())
    if path[-1] == "self":
        path = path[:-1]
    return [(path, alias.strip() or path[-1])]


class Crate:
    """The modules of a crate: their files, the items that they define, and what they import."""

    def __init__(self, root: pathlib.Path) -> None:
        self.code: dict[tuple[str, ...], str] = {}
        self.files: dict[tuple[str, ...], pathlib.Path] = {}
        self.read((), root, root.parent)
        self.items = {module: set(ITEM.findall(code)) for module, code in self.code.items()}
        self.uses = {
            module: [(bool(public), *leaf) for public, tree in USE.findall(code) for leaf in leaves(tree)]
            for module, code in self.code.items()
        }

    def read(self, module: tuple[str, ...], file: pathlib.Path, directory: pathlib.Path) -> None:
        code = without_tests(without_comments_and_texts(file.read_text()))
        self.code[module], self.files[module] = code, file
        # `#[path]` is in the text only before literals are removed.
        places = dict(re.findall(r'^#\[path = "([^"]+)"\]\s*(?:pub\s+)?mod\s+(\w+);', file.read_text(), re.M))
        places = {name: directory / place for place, name in places.items()}
        for name in re.findall(r"^\s*(?:#\[path = \"\"\]\s*)?(?:pub(?:\([^)]*\))?\s+)?mod\s+(\w+);", code, re.M):
            for child in (places.get(name, directory / f"{name}.rs"), directory / name / "mod.rs"):
                if child.exists():
                    self.read((*module, name), child, child.parent if name in places else directory / name)

    def resolve(self, module: tuple[str, ...], path: tuple[str, ...]) -> tuple[str, ...] | None:
        """The absolute path, without `crate`, of a path in a module; None if it leads out of the crate."""
        if path[0] == "crate":
            return path[1:]
        if path[0] == "self":
            return module + path[1:]
        if path[0] == "super":
            here = module
            while path and path[0] == "super":
                here, path = here[:-1], path[1:]
            return here + path
        if (*module, path[0]) in self.code:
            return module + path
        return None

    def definer(self, path: tuple[str, ...], seen: frozenset = frozenset()) -> tuple[str, ...] | None:
        """The module that defines what a path names. Follows what is re-exported."""
        if path in seen:
            return None
        for length in range(len(path) - 1, -1, -1):
            module = path[:length]
            if module not in self.code:
                continue
            name = path[length]
            if name in self.items[module]:
                return module
            for _, used, alias in self.uses[module]:
                if alias in (name, "*") and (target := self.resolve(module, used)) is not None:
                    whole = (target[:-1] + path[length:]) if alias == "*" else target + path[length + 1 :]
                    found = self.definer(whole, seen | {path})
                    if found is not None:
                        return found
            return None
        return None

    def dependencies(self, module: tuple[str, ...]) -> dict[tuple[str, ...], set[str]]:
        """The modules whose items a module names, with these items. What it only re-exports does not count."""
        code = USE.sub("", self.code[module])
        found: dict[tuple[str, ...], set[str]] = {}

        def add(path: tuple[str, ...] | None) -> None:
            if path and (target := self.definer(path)) is not None and target != module:
                found.setdefault(target, set()).add(path[-1])

        aliases = {}
        for public, path, alias in self.uses[module]:
            target = self.resolve(module, path)
            if target is None:
                continue
            aliases[alias] = target
            if alias == "*":
                for name in self.items.get(target[:-1], ()):
                    if re.search(rf"\b{name}\b", code):
                        add((*target[:-1], name))
            elif not public or re.search(rf"\b{alias}\b", code):
                add(target)
        for text in PATH.findall(code):
            path = tuple(text.split("::"))
            add(aliases[path[0]] + path[1:] if path[0] in aliases else self.resolve(module, path))
        return found


def circles(graph: dict) -> list[list]:
    """The strongly connected sets of more than one module."""
    order, low, stack, found = {}, {}, [], []

    def visit(node) -> None:
        order[node] = low[node] = len(order)
        stack.append(node)
        for other in graph[node]:
            if other not in order:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], order[other])
        if low[node] == order[node]:
            at = stack.index(node)
            members, stack[at:] = stack[at:], []
            if len(members) > 1:
                found.append(sorted(members))

    for node in graph:
        if node not in order:
            visit(node)
    return found


def graph_of(crate: Crate) -> dict:
    """The dependencies of each module of a crate."""
    return {module: crate.dependencies(module) for module in crate.code}


def long_files(crate: Crate) -> list[pathlib.Path]:
    """The files of a crate with more than the allowed number of lines, without their tests."""
    products = {file: file.read_text().split("#[cfg(test)]\nmod ")[0] for file in crate.files.values()}
    return [file for file, product in products.items() if product.count("\n") > MAX_LINES]


def check_example() -> None:
    """Two files that name each other, one by `use` and one by path, and a parent that only re-exports. The file that
    `#[path]` names is too long; another one is long by its tests alone."""
    with tempfile.TemporaryDirectory() as directory:
        source = pathlib.Path(directory)
        (source / "lib.rs").write_text('mod a;\n#[path = "other/place.rs"]\nmod b;\nmod c;\npub use a::Low;\n')
        (source / "a.rs").write_text("pub struct Low;\npub fn up() { crate::b::high() }\n")
        (source / "other").mkdir()
        line = "// A line.\n"
        place = source / "other/place.rs"
        place.write_text("use super::Low;\npub fn high() { let _ = Low; }\n" + line * MAX_LINES)
        (source / "c.rs").write_text(line * MAX_LINES + "#[cfg(test)]\nmod tests {\n" + line * MAX_LINES + "}\n")
        crate = Crate(source / "lib.rs")
        found = circles(graph_of(crate))
        assert found == [[("a",), ("b",)]], f"the example's circle is not found: {found}"
        assert long_files(crate) == [place], f"the example's long file is not found: {long_files(crate)}"


def main() -> int:
    check_example()
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else pathlib.Path(__file__).resolve().parent.parent.parent)
    sys.setrecursionlimit(10_000)
    number, long = 0, []
    roots = [root / f"growbot-{name}/src/lib.rs" for name in CRATES]
    # Programs are crates of their own.
    roots += [*sorted(root.glob("growbot-firmware/boards/*/main.rs")), root / "growbot-host/src/main.rs"]
    for file in roots:
        crate = Crate(file)
        graph = graph_of(crate)
        long += [str(file.relative_to(root)) for file in long_files(crate)]
        for members in circles(graph):
            number += 1
            print(f"{file.relative_to(root)}: {len(members)} files name items of each other:")
            for member in members:
                for other in members:
                    if other in graph[member]:
                        names = ", ".join(sorted(graph[member][other])[:6])
                        here, there = (crate.files[module].relative_to(root) for module in (member, other))
                        print(f"    {here} -> {there}: {names}")
    print(f"{number} circles of imports, {len(long)} files above {MAX_LINES} lines: {', '.join(long) or '-'}")
    return 1 if number or long else 0


if __name__ == "__main__":
    sys.exit(main())
