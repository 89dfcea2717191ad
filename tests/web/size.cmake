# Fails if a module is larger than MOST_KB when it is deflated, as servers send it.
# Run: cmake -D MODULE=... -D MOST_KB=... -P size.cmake
cmake_minimum_required(VERSION 3.25)
file(ARCHIVE_CREATE OUTPUT ${MODULE}.gz PATHS ${MODULE} FORMAT raw COMPRESSION GZip COMPRESSION_LEVEL 9)
file(SIZE ${MODULE}.gz bytes)
math(EXPR kilobytes "(${bytes} + 999) / 1000")
message(STATUS "${MODULE}: ${kilobytes} KB deflated")
if(kilobytes GREATER MOST_KB)
  message(FATAL_ERROR "${MODULE} has ${kilobytes} KB when it is deflated: more than ${MOST_KB}")
endif()
