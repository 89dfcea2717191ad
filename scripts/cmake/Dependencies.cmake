# Every package comes from the distribution; scripts/install-packages lists them.
if(EMSCRIPTEN)
  include(scripts/cmake/Web.cmake)
  return()
endif()
find_package(PkgConfig REQUIRED)
find_package(Threads REQUIRED)
find_package(fmt REQUIRED)
find_package(glm REQUIRED)
find_package(tl-expected REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(TBB REQUIRED)
find_package(meshoptimizer REQUIRED)
find_package(CGAL 5.5 REQUIRED)
include(CGAL_TBB_support)
find_package(CURL 7.87 REQUIRED)
find_package(Freetype REQUIRED)
find_file(SPLATVOL_FONT_FILE DejaVuSans.ttf REQUIRED
  PATHS /usr/share/fonts/truetype/dejavu /usr/share/fonts/TTF /usr/share/fonts/dejavu-sans-fonts
  DOC "DejaVu Sans, for titles and scalar bars (package fonts-dejavu-core)")
find_package(PNG REQUIRED)
find_package(OpenEXR REQUIRED)
pkg_check_modules(ZSTD REQUIRED IMPORTED_TARGET libzstd)
pkg_check_modules(XXHASH REQUIRED IMPORTED_TARGET libxxhash)
pkg_check_modules(HWY REQUIRED IMPORTED_TARGET libhwy)
if(SPLATVOL_OPENGL)
  pkg_check_modules(EPOXY REQUIRED IMPORTED_TARGET epoxy)
  pkg_check_modules(EGL REQUIRED IMPORTED_TARGET egl)
  pkg_check_modules(IMGUI REQUIRED IMPORTED_TARGET imgui)
  find_package(glfw3 REQUIRED)
endif()

if(NOT SPLATVOL_PROGRAMS)
  return()
endif()
find_package(CLI11 REQUIRED)
if(SPLATVOL_MPI)
  find_package(MPI REQUIRED COMPONENTS CXX)
endif()

find_package(ZLIB REQUIRED)

# OpenVDB's own module asks for development packages of what its library alone needs. Its headers convert 16-bit floats:
# by a table of Imath's where the processor may lack the instruction (SPLATVOL_AVX2=OFF).
find_path(OPENVDB_INCLUDE_DIR openvdb/openvdb.h REQUIRED)
find_library(OPENVDB_LIBRARY openvdb REQUIRED)
add_library(OpenVDB::openvdb UNKNOWN IMPORTED)
set_target_properties(OpenVDB::openvdb PROPERTIES
  IMPORTED_LOCATION ${OPENVDB_LIBRARY}
  INTERFACE_INCLUDE_DIRECTORIES ${OPENVDB_INCLUDE_DIR}
  INTERFACE_LINK_LIBRARIES "TBB::tbb;Imath::Imath"
  # Its templates have static members that must be those of its library: their symbols may not be hidden.
  INTERFACE_COMPILE_OPTIONS -fvisibility=default)

# VTK 9.1's package asks for MPI's targets without finding them itself.
find_package(MPI QUIET)
find_package(VTK 9.1 REQUIRED COMPONENTS CommonCore CommonDataModel CommonExecutionModel IOXML IOLegacy IOParallel IOXMLParser IOCore
  IOExodus IOEnSight IOGeometry IOPLY IOCGNSReader FiltersCore FiltersFlowPaths exodusII cgns)
