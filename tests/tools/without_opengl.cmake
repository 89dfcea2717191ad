# Configures a build without OpenGL. Run: cmake -D SOURCE=... -D BUILD=... -P without_opengl.cmake
cmake_minimum_required(VERSION 3.25)

file(REMOVE_RECURSE ${BUILD})
execute_process(
  COMMAND ${CMAKE_COMMAND} -S ${SOURCE} -B ${BUILD} -G Ninja -D SPLATVOL_OPENGL=OFF
          -D CMAKE_DISABLE_FIND_PACKAGE_glfw3=ON -D CMAKE_EXPORT_COMPILE_COMMANDS=OFF
  RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "${output}")
endif()

file(READ ${BUILD}/build.ninja ninja)
foreach(needed IN ITEMS bin/svrender bin/svbuild tile_rasterizer.cpp)
  if(NOT ninja MATCHES "${needed}")
    message(FATAL_ERROR "${needed} is not built")
  endif()
endforeach()
foreach(unwanted IN ITEMS libepoxy libEGL libglfw libimgui gl_rasterizer.cpp bin/svview)
  if(ninja MATCHES "${unwanted}")
    message(FATAL_ERROR "${unwanted} is asked for")
  endif()
endforeach()
file(REMOVE_RECURSE ${BUILD})
