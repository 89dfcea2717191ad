# Headers that most sources include are read once. A precompiled header serves the compiler's flags that it was made with:
# the layers' own (splatvol_base), the programs' (splatvol_tool) and the tests' (tests/CMakeLists.txt). Sources of
# OpenVDB and VTK have one of their own. Each source still includes what it uses: scripts/lint compiles without
# precompiled headers.
set(SPLATVOL_HEADERS <algorithm> <array> <atomic> <bit> <chrono> <cmath> <condition_variable> <cstdint> <cstring>
    <filesystem> <fstream> <functional> <limits> <map> <memory> <mutex> <optional> <random> <ranges> <span> <string>
    <string_view> <thread> <unordered_map> <utility> <variant> <vector> <fmt/format.h> <glm/glm.hpp>
    <glm/gtc/quaternion.hpp> <tl/expected.hpp>)
if(NOT EMSCRIPTEN)
  list(APPEND SPLATVOL_HEADERS <tbb/parallel_for.h>)
endif()

# splatvol_share_headers(OWNER FOLDER...): the libraries of folders, and of those below, take OWNER's precompiled header.
function(splatvol_share_headers owner)
  foreach(folder IN LISTS ARGN)
    get_property(targets DIRECTORY ${folder} PROPERTY BUILDSYSTEM_TARGETS)
    foreach(target IN LISTS targets)
      get_target_property(type ${target} TYPE)
      get_target_property(owned ${target} PRECOMPILE_HEADERS)
      get_target_property(without ${target} DISABLE_PRECOMPILE_HEADERS)
      if(type MATCHES "LIBRARY|EXECUTABLE" AND NOT type STREQUAL "INTERFACE_LIBRARY" AND NOT owned AND NOT without)
        target_precompile_headers(${target} REUSE_FROM ${owner})
        # clang stops at such a header anyway.
        target_compile_options(${target} PRIVATE $<$<CXX_COMPILER_ID:GNU>:-Werror=invalid-pch>)
      endif()
    endforeach()
    get_property(folders DIRECTORY ${folder} PROPERTY SUBDIRECTORIES)
    splatvol_share_headers(${owner} ${folders})
  endforeach()
endfunction()
