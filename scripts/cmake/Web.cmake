# The engine for browsers, compiled by emscripten. Of other packages it takes headers, and zstd's decompression out of the
# source package: what lies in Debian's libraries is for other processors.
add_compile_options(-msimd128 -fwasm-exceptions $<$<COMPILE_LANGUAGE:CXX>:-fexperimental-library>)
add_link_options(-fwasm-exceptions -fexperimental-library
  -sALLOW_MEMORY_GROWTH=1 -sMAXIMUM_MEMORY=4GB -sABORTING_MALLOC=0 -sSTACK_SIZE=1MB)

# Links to headers: beside them lie the C library's for this machine.
set(headers ${PROJECT_BINARY_DIR}/headers)
foreach(header fmt glm hwy nlohmann tl xxhash.h)
  if(NOT EXISTS /usr/include/${header})
    message(FATAL_ERROR "No /usr/include/${header}: scripts/web tells which packages it needs")
  endif()
  file(MAKE_DIRECTORY ${headers})
  file(CREATE_LINK /usr/include/${header} ${headers}/${header} SYMBOLIC)
endforeach()

# splatvol_headers(TARGET): an imported target with these headers.
function(splatvol_headers target)
  add_library(${target} INTERFACE IMPORTED)
  target_include_directories(${target} INTERFACE ${headers})
  target_compile_definitions(${target} INTERFACE ${ARGN})
endfunction()
splatvol_headers(fmt::fmt FMT_HEADER_ONLY)
splatvol_headers(glm::glm)
splatvol_headers(tl::expected)
splatvol_headers(nlohmann_json::nlohmann_json)
splatvol_headers(PkgConfig::HWY HWY_COMPILE_ONLY_STATIC)

file(WRITE ${PROJECT_BINARY_DIR}/generated/xxhash.c "#define XXH_STATIC_LINKING_ONLY\n#define XXH_IMPLEMENTATION\n#include <xxhash.h>\n")
add_library(splatvol_xxhash STATIC ${PROJECT_BINARY_DIR}/generated/xxhash.c)
target_include_directories(splatvol_xxhash SYSTEM PUBLIC ${headers})
target_compile_options(splatvol_xxhash PRIVATE -mno-simd128)  # its vectors need a header that Debian leaves out
add_library(PkgConfig::XXHASH ALIAS splatvol_xxhash)

# Tests also compress.
set(SPLATVOL_ZSTD "" CACHE PATH "The folder lib/ of zstd's sources: scripts/web fetches them")
set(zstd ${SPLATVOL_ZSTD})
file(GLOB decompression ${zstd}/common/*.c ${zstd}/decompress/*.c)
if(NOT decompression)
  message(FATAL_ERROR "No sources of zstd in SPLATVOL_ZSTD='${zstd}'")
endif()
add_library(splatvol_zstd STATIC ${decompression})
target_include_directories(splatvol_zstd SYSTEM PUBLIC ${zstd})
target_compile_definitions(splatvol_zstd PRIVATE ZSTD_DISABLE_ASM ZSTD_LEGACY_SUPPORT=0)
target_compile_options(splatvol_zstd PRIVATE -w)
file(GLOB compression ${zstd}/compress/*.c)
add_library(splatvol_zstd_compression STATIC EXCLUDE_FROM_ALL ${compression})
target_compile_options(splatvol_zstd_compression PRIVATE -w)
target_link_libraries(splatvol_zstd_compression PUBLIC splatvol_zstd)
add_library(PkgConfig::ZSTD ALIAS splatvol_zstd)
