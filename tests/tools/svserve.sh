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
echo secret > "$work/outside.svol"

fail() {
  echo "$1" >&2
  cat "$work/out.txt" "$work/err.txt" >&2
  exit 1
}

# Another program may have taken a port.
for ((port = 20000 + RANDOM % 20000, tries = 0; tries < 10; ++port, ++tries)); do
  "$programs/svserve" --address 127.0.0.1 --port "$port" "$work/data" > "$work/out.txt" 2> "$work/err.txt" &
  server=$!
  until grep -q 'Ctrl-C' "$work/out.txt" || ! kill -0 "$server" 2> /dev/null; do sleep 0.05; done
  ! grep -q 'Ctrl-C' "$work/out.txt" || break
done

url=$(head -n 1 "$work/out.txt")
[[ $url == "http://127.0.0.1:$port/with%20space/v.svol" ]] || fail "it prints the address of the file"
"$programs/svinfo" "$url" > "$work/info.txt" || fail "its files can be read"
grep -q '1000 points' "$work/info.txt" || fail "they are the files"
for name in notes.txt .hidden/v.svol ../outside.svol '%2e%2e/outside.svol' ''; do
  ! "$programs/svinfo" "http://127.0.0.1:$port/$name" > /dev/null 2> "$work/err.txt" || fail "$name is not shared"
done
! "$programs/svserve" --port "$port" --address 127.0.0.1 "$work/data" 2> "$work/err.txt" > "$work/out.txt" ||
  fail "a port has one server"
grep -q 'Address already in use' "$work/err.txt" || fail "it says why it does not start"
! "$programs/svserve" "$work/none" 2> "$work/err.txt" || fail "no such folder"

kill "$server"
wait "$server" || true
server=''
! "$programs/svinfo" "$url" > /dev/null 2>&1 || fail "it ends with the program"
