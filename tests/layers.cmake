# Fails if a source includes a header of a layer that its own layer may not know. The layers stand in order, lowest first:
# a layer may know only layers before it, so that no arrow runs back. Run: cmake -D ROOT=... -P layers.cmake
cmake_minimum_required(VERSION 3.25)

set(layers
    base scene reference format
    builder/sorting builder/mesh builder/scattered builder/sources builder/sources/vtk builder/output builder/points
    builder/reduction builder
    exporter streamer renderer viewer tools)

# What each layer may include, besides itself.
set(base_knows)
set(scene_knows base)
set(reference_knows base scene)
set(format_knows base)
set(builder/sorting_knows base format)
set(builder/mesh_knows base format)
set(builder/scattered_knows base format builder/mesh)
set(builder/sources_knows base format builder/mesh builder/sorting)
set(builder/sources/vtk_knows base format builder/mesh builder/sources)
set(builder/output_knows base format builder/mesh builder/sorting)
set(builder/points_knows base format builder/sorting builder/mesh builder/scattered builder/sources)
set(builder/reduction_knows base format builder/sorting builder/mesh builder/scattered builder/output builder/points)
set(builder_rooms builder/sorting builder/mesh builder/scattered builder/sources builder/sources/vtk builder/output
                  builder/points builder/reduction)
set(builder_knows base format ${builder_rooms})
set(exporter_knows base format)
set(streamer_knows base scene format)
set(renderer_knows base scene streamer)
set(viewer_knows base scene format streamer renderer)
set(tools_knows base scene reference format ${builder_rooms} builder exporter streamer renderer viewer)

# Only these layers may include headers of OpenGL, and of VTK.
set(gl_folders epoxy EGL GL GLES3 GLFW)
set(gl_layers renderer viewer tools)
set(vtk_layers builder/sources/vtk)

set(broken)

set(below)
foreach(layer IN LISTS layers)
  foreach(known IN LISTS ${layer}_knows)
    if(NOT known IN_LIST below)
      list(APPEND broken "${layer} knows ${known}, which does not stand before it: the arrow runs back")
    endif()
  endforeach()
  list(APPEND below ${layer})
endforeach()

# The layer that a path lies in: the one with the longest name that the path begins with; empty for none.
function(layer_of path result)
  set(found)
  cmake_path(GET path PARENT_PATH folder)
  while(folder AND NOT found)
    if(folder IN_LIST layers)
      set(found ${folder})
    endif()
    cmake_path(GET folder PARENT_PATH folder)
  endwhile()
  set(${result} "${found}" PARENT_SCOPE)
endfunction()

set(tops ${layers})
list(FILTER tops EXCLUDE REGEX "/")
foreach(top IN LISTS tops)
  file(GLOB_RECURSE sources RELATIVE ${ROOT} ${ROOT}/${top}/*.h ${ROOT}/${top}/*.cpp)
  foreach(source IN LISTS sources)
    layer_of(${source} layer)
    file(STRINGS ${ROOT}/${source} includes REGEX "^[ \t]*#[ \t]*include[ \t]*[<\"]")
    foreach(include IN LISTS includes)
      string(REGEX REPLACE "^[ \t]*#[ \t]*include[ \t]*([<\"])([^>\"]*).*" "\\1;\\2" parts "${include}")
      list(GET parts 0 quote)
      list(GET parts 1 header)
      string(REGEX REPLACE "/.*" "" folder "${header}")
      layer_of(${header} header_layer)

      if(folder IN_LIST gl_folders)
        if(NOT layer IN_LIST gl_layers)
          list(APPEND broken "${source} includes ${header}: ${layer} may not know OpenGL")
        endif()
      elseif(quote STREQUAL "<" AND header MATCHES "^vtk[A-Za-z0-9_]*\\.h$")
        if(NOT layer IN_LIST vtk_layers)
          list(APPEND broken "${source} includes ${header}: ${layer} may not know VTK")
        endif()
      elseif(header_layer)
        if(NOT header_layer STREQUAL layer AND NOT header_layer IN_LIST ${layer}_knows)
          list(APPEND broken "${source} includes ${header}: ${layer} may not know ${header_layer}")
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
