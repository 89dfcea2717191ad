#!/usr/bin/env bash
# Tests of what `cmake --install` makes. Run: installed.sh TEST BUILD_FOLDER SOURCE_FOLDER COMPILER [IS_HARDENED_RELEASE]
# The test `install` goes first: it installs into BUILD_FOLDER/installed/prefix.
set -euo pipefail
test=$1
build=$2
source=$3
export CXX=$4
work=$build/installed
prefix=$work/prefix
libraries=$prefix/lib
[[ -d $libraries/cmake/splatvol ]] || libraries=$(dirname "$(find "$prefix" -name 'libsplatvol_read.so' 2> /dev/null)")

fail() {
  echo "$*" >&2
  exit 1
}

# Programs and libraries must not know where they are: they are moved after they have been installed.
test_install() {
  rm -rf "$work"
  cmake --install "$build" --prefix "$work/first" > /dev/null
  mv "$work/first" "$prefix"
}

# Public headers include each other, the standard library, glm and tl-expected: nothing else. Each compiles alone.
test_headers() {
  local others
  others=$(grep -rhE '^ *# *include' "$prefix/include/splatvol" |
    grep -vE '["<]splatvol/[a-z_]+\.h[">]|<tl/expected\.hpp>|<glm/[a-z0-9_/]+\.hpp>|<[a-z_]+>$' || true)
  [[ -z $others ]] || fail "public headers include others: $others"
  find "$prefix/include/splatvol" -name '*.h' -printf '%f\n' | sort > "$work/headers.txt"
  [[ $(wc -l < "$work/headers.txt") -ge 10 ]] || fail "headers are missing"
  export prefix
  xargs -P 2 -I {} bash -c 'echo "#include <splatvol/{}>" |
    "$CXX" -std=c++20 -Wall -Wextra -Wpedantic -Werror -fsyntax-only -I "$prefix/include" -x c++ - ||
    { echo "{} does not compile alone" >&2; exit 255; }' < "$work/headers.txt"
}

# The libraries export what public headers declare with SPLATVOL_EXPORT. Weak names are of templates.
test_exports() {
  local library name names exported others all=''
  exported='splatvol::(File|GlRenderer|Renderer|TransferFunction)::'
  exported+='|splatvol::(append_to_series|build|build_series|write_image|is_image_path|parse_scene|load_scene|scene_to_json|name_of)(\[abi:cxx11\])?\('
  for library in read render build; do
    names=$(nm -D --defined-only -C "$libraries/libsplatvol_$library.so" | grep -E ' [A-TX-Z] ' || true)
    [[ -n $names ]] || fail "libsplatvol_$library.so exports nothing"
    others=$(grep -vE "^[0-9a-f]* [A-Z] ($exported)" <<< "$names" || true)
    [[ -z $others ]] || fail "libsplatvol_$library.so exports others: $others"
    all+=$names
  done
  for name in $(grep -hv '#define' "$prefix"/include/splatvol/*.h | grep -oE 'SPLATVOL_EXPORT [^(;{]*\(' | grep -oE '[a-z_]+\($'); do
    grep -qE "splatvol::${name%(}(\[abi:cxx11\])?\(" <<< "$all" || fail "no library exports $name)"
  done
}

# What each library needs, besides the C and C++ libraries.
needs() {
  local needed others
  needed=$(readelf --wide --dynamic "$libraries/libsplatvol_$1.so" | sed -n 's/.*(NEEDED).*\[\(lib[^]]*\)\.so[^]]*\]/\1/p')
  others=$(grep -vxE "libstdc\+\+|libgcc_s|libc|libm|ld-linux.*|$2" <<< "$needed" || true)
  [[ -z $others ]] || fail "libsplatvol_$1.so needs others: $others"
}
test_needs() {
  needs read 'libzstd|libxxhash|libfmt'
  needs render 'libzstd|libxxhash|libfmt|libtbb|libhwy|libepoxy|libEGL|libpng16|libfreetype|libOpenEXR.*|libImath.*|libIlmThread.*|libIex.*'
  needs build 'libzstd|libxxhash|libfmt|libtbb|libtbbmalloc|libgmp|libmpfr|libmeshoptimizer'
  [[ $(readelf --wide --dynamic "$libraries/libsplatvol_read.so") == *'soname: [libsplatvol_read.so.0.3]'* ]] ||
    fail "the library's name has the minor version"
}

# Where a program of this prefix fails for want of an option of the sanitizers, this says so.
test_programs() {
  local bin=$prefix/bin
  cd "$(mktemp -d -p "$work")"
  "$bin/svgen" mesh --cells 3000 --pieces 1 -o mesh > gen.txt
  "$bin/svbuild" mesh/*.vtu -o mesh.svol > build.txt
  "$bin/svinfo" --verify mesh.svol > info.txt
  "$bin/svrender" --device cpu --size 64x48 mesh.svol -o mesh.png
  "$bin/svserve" --help > serve.txt
  [[ $(head -c 4 mesh.png) == $'\x89PNG' ]] || fail "svrender writes no picture"
  [[ ! -e $bin/splatvol-read ]] || fail "splatvol-read is a program for programs, not in the path"
}

# What bash offers behind a command line, word by word: the last one is being typed.
offers() {
  (
    set +e
    # shellcheck disable=SC1090
    source "$prefix/share/bash-completion/completions/$1"
    COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
    "_$1"
    echo "${COMPREPLY[*]}"
  )
}
expect_offers() {
  local expected=$1 offered
  shift
  offered=$(offers "$@")
  [[ $offered == "$expected" ]] || fail "'$*' offers '$offered', not '$expected'"
}

# Man pages and completions are made of the programs' options.
test_manual() {
  local program page
  for program in svbuild svdiff svexport svgen svinfo svrender svserve svtruth; do
    page=$prefix/share/man/man1/$program.1
    grep -q '^\.SH OPTIONS' "$page" || fail "no man page of $program"
    # A date would make each build another.
    ! command -v mandoc > /dev/null || mandoc -T lint -W warning "$page" | grep -v 'missing date' > "$work/lint.txt" ||
      true
    [[ ! -s $work/lint.txt ]] || fail "$(< "$work/lint.txt")"
    bash -n "$prefix/share/bash-completion/completions/$program"
    ! command -v zsh > /dev/null || zsh -n "$prefix"/share/zsh/*/"_$program"
    ! command -v fish > /dev/null || fish --no-execute "$prefix/share/fish/vendor_completions.d/$program.fish"
  done
  cd "$(mktemp -d -p "$work")"
  mkdir folder
  touch 'a b.svol' c.svols d.txt e.json
  expect_offers '--tolerance' svrender --to
  expect_offers 'auto cpu gl' svrender --device ''
  expect_offers 'cpu' svrender --device = c
  expect_offers 'folder a b.svol c.svols' svrender ''
  expect_offers 'folder e.json' svrender x.svol --scene ''
  expect_offers 'folder' svrender x.svol --progress-frames ''
  expect_offers '' svrender x.svol --tolerance ''
  expect_offers 'points' svgen po
  expect_offers 'uniform vortex half-tiny equal two-clusters line layer clusters' svgen points --distribution ''
  expect_offers 'folder' svserve ''
}

# The desktop's files, by its own programs where these are there.
test_desktop() {
  local share=$prefix/share
  [[ -s $share/icons/hicolor/scalable/apps/splatvol.svg ]] || fail "no icon"
  [[ ! -e $prefix/bin/svview ]] || ! command -v desktop-file-validate > /dev/null ||
    desktop-file-validate "$share/applications/splatvol.desktop"
  command -v update-mime-database > /dev/null || return 0
  XDG_DATA_DIRS=$share update-mime-database "$share/mime"
  grep -q '^application/x-svol:\*\.svol$' "$share/mime/globs" || fail "no type for .svol"
  grep -q '^application/x-svols:\*\.svols$' "$share/mime/globs" || fail "no type for .svols"
}

# The page of the libraries shows code of the examples.
test_page() {
  local line
  sed -n '/^```c/,/^```$/{/^```/d;p}' "$source/docs/library.md" > "$work/shown.txt"
  [[ -s $work/shown.txt ]] || fail "docs/library.md shows no code"
  while IFS= read -r line; do
    grep -qxF -- "${line#  }" <(sed 's/^  //' "$source"/library/examples/*) || fail "docs/library.md shows what no example has: $line"
  done < "$work/shown.txt"
  # Its CMakeLists.txt is a project as it stands.
  rm -rf "$work/pasted"
  mkdir "$work/pasted"
  sed -n '/^```cmake/,/^```$/{/^```/d;p}' "$source/docs/library.md" > "$work/pasted/CMakeLists.txt"
  cp "$source/library/examples/read.cpp" "$work/pasted"
  cmake -S "$work/pasted" -B "$work/pasted/out" -D CMAKE_PREFIX_PATH="$prefix" > "$work/pasted/configure.txt" ||
    fail "the CMakeLists.txt of docs/library.md does not work"
  cmake --build "$work/pasted/out" > "$work/pasted/build.txt" || { cat "$work/pasted/build.txt" >&2; exit 1; }
}

# The examples, configured as a project of somebody else.
test_examples() {
  rm -rf "$work/examples"
  cp -r "$source/library/examples" "$work/examples"
  cd "$work/examples"
  cmake -S . -B out -D CMAKE_PREFIX_PATH="$prefix" -D CMAKE_CXX_FLAGS='-Wall -Wextra -Wpedantic -Werror' > configure.txt
  cmake --build out --parallel 2 > build.txt || { cat build.txt >&2; exit 1; }
  out/build ring.svol > built.txt
  grep -q '64000 cells, 68921 points' built.txt || fail "build: $(< built.txt)"
  "$prefix/bin/svinfo" --verify ring.svol > /dev/null
  out/read ring.svol > read.txt
  grep -q 'speed: 0 to 10 m/s' <(sed 's/[0-9.]*e-[0-9]*/0/' read.txt) || fail "read: $(< read.txt)"
  grep -qE 'stand for a volume of (8|7\.99+[0-9]*|8\.00+[0-9]*)$' read.txt || fail "read: $(< read.txt)"
  out/render ring.svol ring.png > render.txt
  [[ $(head -c 4 ring.png) == $'\x89PNG' ]] || fail "render writes no picture"
  awk '$(NF) > 0.002 { exit 1 }' render.txt || fail "the error is too large: $(< render.txt)"
  if [[ -e $prefix/include/splatvol/gl_renderer.h && -x out/window ]] && command -v xvfb-run > /dev/null; then
    xvfb-run --auto-servernum out/window ring.svol window.png || fail "window fails"
    [[ $(head -c 4 window.png) == $'\x89PNG' ]] || fail "window writes no picture"
  fi
  ! out/read ring.png > /dev/null 2> error.txt || fail "a picture is no file to read"
  grep -q '^read: ring.png' error.txt || fail "the error does not name the file: $(< error.txt)"
}

"test_$test"
