# Fails if a module for browsers has code of a library that it shall not have.
# Run: cmake -D MAP=... -P linked.cmake, with the linker's map.
cmake_minimum_required(VERSION 3.25)

# Ours, zstd's decompression and xxHash; emscripten's C and C++ libraries.
set(ours base splat scene pictures format sampler decode store streamer first shown_cells renderer renderer_cpu
         renderer_device surfaces player web_files zstd xxhash)
list(JOIN ours "|" ours)
set(allowed "^lib(splatvol_(${ours})|c|c[+][+]|c[+][+]abi|compiler_rt|dlmalloc|unwind|stubs|noderawfs|c_rt|GL|al|html5|sockets)(-[a-z-]+)?[.]a$")

file(STRINGS ${MAP} lines REGEX "[.]a[(]")
set(broken)
set(seen)
foreach(line IN LISTS lines)
  string(REGEX MATCH "[^/ ]+[.]a[(][^)]*[)]" member "${line}")
  if(NOT member OR member IN_LIST seen)
    continue()
  endif()
  list(APPEND seen ${member})
  string(REGEX REPLACE "[(].*" "" library "${member}")
  if(NOT library MATCHES "${allowed}")
    list(APPEND broken "${member} is linked")
  endif()
endforeach()
if(NOT seen)
  message(FATAL_ERROR "${MAP} names no members of libraries")
endif()
if(broken)
  list(JOIN broken "\n  " broken)
  message(FATAL_ERROR "a module for browsers has what it shall not have:\n  ${broken}")
endif()
