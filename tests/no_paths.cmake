# Fails if a program names the folder that it was built from. Run: cmake -D PROGRAM=... -D ROOT=... -P no_paths.cmake
cmake_minimum_required(VERSION 3.25)
string(REGEX REPLACE "([^A-Za-z0-9_/-])" "\\\\\\1" root ${ROOT}/)
file(STRINGS ${PROGRAM} paths REGEX ${root})
if(paths)
  message(FATAL_ERROR "${PROGRAM} has bytes that depend on the folder of its sources: ${paths}")
endif()
