#!/usr/bin/env bash
# svserve shares .svol files and nothing else. Run: svserve.sh FOLDER_OF_PROGRAMS
set -euo pipefail
programs=$1
PATH=$PATH:/usr/sbin:/usr/local/sbin command -v nginx > /dev/null || {
  echo "no nginx on this machine (package nginx)"
  exit 77
}
work=$(mktemp -d)
server=''
trap '[[ -z $server ]] || kill "$server"; wait; rm -rf "$work"' EXIT
mkdir -p "$work/data/with space" "$work/data/.hidden"
"$programs/svbuild" gen:points:count=1000 -o "$work/data/with space/v.svol" > /dev/null
cp "$work/data/with space/v.svol" "$work/data/.hidden"
echo secret > "$work/data/notes.txt"
cp "$work/data/with space/v.svol" "$work/outside.svol"
mkdir "$work/elsewhere"
cp "$work/data/with space/v.svol" "$work/elsewhere"
ln -s "with space/v.svol" "$work/data/within (1).svol"
ln -s "with space" "$work/data/folder"
ln -s ../outside.svol "$work/data/out.svol"
ln -s ../elsewhere "$work/data/away"
ln -s notes.txt "$work/data/notes.svol"
ln -s .hidden/v.svol "$work/data/hidden.svol"

fail() {
  echo "$1" >&2
  cat "$work/out.txt" "$work/err.txt" >&2
  exit 1
}

# Starts it with these options. Another program may have taken a port.
start() {
  for ((port = 20000 + RANDOM % 20000, tries = 0; tries < 10; ++port, ++tries)); do
    "$programs/svserve" --address 127.0.0.1 --port "$port" "$@" "$work/data" > "$work/out.txt" 2> "$work/err.txt" &
    server=$!
    until grep -q 'Ctrl-C' "$work/out.txt" || ! kill -0 "$server" 2> /dev/null; do sleep 0.05; done
    ! grep -q 'Ctrl-C' "$work/out.txt" || break
  done
}
stop() {
  kill "$server"
  wait "$server" || true
  server=''
}
serves() { "$programs/svinfo" "http://127.0.0.1:$port/$1" > "$work/info.txt" 2>&1; }

start
url=$(grep v.svol "$work/out.txt")
[[ $url == "http://127.0.0.1:$port/with%20space/v.svol" ]] || fail "it prints the address of the file"
"$programs/svinfo" "$url" > "$work/info.txt" || fail "its files can be read"
grep -q '1000 points' "$work/info.txt" || fail "they are the files"

# Links: those that lead out, or round what is not shared, are left out and named.
serves 'within%20(1).svol' && serves folder/v.svol || fail "links within the folder are followed"
left_out=$(printf 'svserve: %s: not shared: a link leads out of what is shared; --follow-links follows it\n' \
  away/v.svol hidden.svol notes.svol out.svol)
[[ $(< "$work/err.txt") == "$left_out" ]] || fail "links out of the folder are named"
ln -s ../outside.svol "$work/data/later.svol"
for name in out.svol away/v.svol notes.svol hidden.svol later.svol; do
  ! serves "$name" && grep -q '403\|404' "$work/info.txt" || fail "$name is not shared"
  ! grep -q "$name" "$work/out.txt" || fail "$name has no address"
done

for name in notes.txt .hidden/v.svol ../outside.svol '%2e%2e/outside.svol' ''; do
  ! "$programs/svinfo" "http://127.0.0.1:$port/$name" > /dev/null 2> "$work/err.txt" || fail "$name is not shared"
done
! "$programs/svserve" --port "$port" --address 127.0.0.1 "$work/data" 2> "$work/err.txt" > "$work/out.txt" ||
  fail "a port has one server"
grep -q 'Address already in use' "$work/err.txt" || fail "it says why it does not start"
! "$programs/svserve" "$work/none" 2> "$work/err.txt" || fail "no such folder"

stop
! "$programs/svinfo" "$url" > /dev/null 2>&1 || fail "it ends with the program"

start --follow-links
serves away/v.svol && serves out.svol || fail "--follow-links follows all links"
[[ ! -s $work/err.txt ]] || fail "--follow-links leaves nothing out"
