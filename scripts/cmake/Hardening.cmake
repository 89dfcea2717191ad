# Files from strangers are read: what a fault in a reader could do is made harder.
# Sanitizers find more, and bring their own checks.
option(SPLATVOL_HARDENED "Stop at overflows of buffers and of the stack, with code at random addresses" ON)
if(NOT SPLATVOL_HARDENED OR EMSCRIPTEN OR CMAKE_CXX_FLAGS MATCHES "-fsanitize" OR NOT CMAKE_CXX_COMPILER_ID MATCHES "GNU|Clang")
  return()
endif()

include(CheckCXXCompilerFlag)
include(CheckLinkerFlag)

foreach(flag -fstack-protector-strong -fstack-clash-protection -fcf-protection)
  string(MAKE_C_IDENTIFIER "SPLATVOL_HAS${flag}" has)
  check_cxx_compiler_flag(${flag} ${has})
  if(${has})
    add_compile_options(${flag})
  endif()
endforeach()
if(NOT CMAKE_BUILD_TYPE STREQUAL "Debug")  # it needs an optimizing compiler
  add_compile_options(-U_FORTIFY_SOURCE -D_FORTIFY_SOURCE=3)
endif()

# Addresses of functions are bound at the start, and cannot be overwritten after it.
foreach(flag -Wl,-z,relro,-z,now -Wl,-z,noexecstack)
  string(MAKE_C_IDENTIFIER "SPLATVOL_HAS${flag}" has)
  check_linker_flag(CXX ${flag} ${has})
  if(${has})
    add_link_options(${flag})
  endif()
endforeach()
add_link_options("$<$<STREQUAL:$<TARGET_PROPERTY:TYPE>,EXECUTABLE>:-pie>")
set(SPLATVOL_IS_HARDENED ON)
