# Fails where a source includes a header of a layer that its own layer may not know. Run: cmake -D ROOT=... -P layers.cmake
cmake_minimum_required(VERSION 3.25)

set(layers base scene reference format builder streamer renderer tools)

# What each layer may include, besides itself.
set(base_knows)
set(scene_knows base)
set(reference_knows base scene)
set(format_knows base)
set(builder_knows base format)
set(streamer_knows base scene format)
set(renderer_knows base scene streamer)
set(tools_knows base scene reference format builder streamer renderer)

# OpenGL is the renderer's and the programs' business alone.
set(gl_folders epoxy EGL GL GLES3 GLFW)
set(gl_layers renderer tools)

set(broken)
foreach(layer IN LISTS layers)
  file(GLOB_RECURSE sources RELATIVE ${ROOT} ${ROOT}/${layer}/*.h ${ROOT}/${layer}/*.cpp)
  foreach(source IN LISTS sources)
    file(STRINGS ${ROOT}/${source} includes REGEX "^[ \t]*#[ \t]*include[ \t]*[<\"]")
    foreach(include IN LISTS includes)
      string(REGEX REPLACE "^[ \t]*#[ \t]*include[ \t]*([<\"])([^>\"]*).*" "\\1;\\2" parts "${include}")
      list(GET parts 0 quote)
      list(GET parts 1 header)
      string(REGEX REPLACE "/.*" "" folder "${header}")

      if(folder IN_LIST gl_folders)
        if(NOT layer IN_LIST gl_layers)
          list(APPEND broken "${source} includes ${header}: ${layer} may not know OpenGL")
        endif()
      elseif(folder IN_LIST layers AND header MATCHES "/")
        if(NOT folder STREQUAL layer AND NOT folder IN_LIST ${layer}_knows)
          list(APPEND broken "${source} includes ${header}: ${layer} may not know ${folder}")
        endif()
      elseif(quote STREQUAL "\"")
        list(APPEND broken "${source} includes ${header}: name it from the project's root")
      endif()
    endforeach()
  endforeach()
endforeach()

if(broken)
  list(JOIN broken "\n" message)
  message(FATAL_ERROR "${message}")
endif()
