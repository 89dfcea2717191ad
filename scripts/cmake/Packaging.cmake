# What is installed besides programs and libraries, and the Debian packages: scripts/package makes them.
# Components: runtime (the programs), library, development.
include(GNUInstallDirs)
set(SPLATVOL_PACKAGING ${PROJECT_SOURCE_DIR}/scripts/packaging)
if(SPLATVOL_OPENGL)
  install(FILES ${SPLATVOL_PACKAGING}/splatvol.desktop DESTINATION ${CMAKE_INSTALL_DATADIR}/applications COMPONENT runtime)
endif()
install(FILES ${SPLATVOL_PACKAGING}/splatvol.svg DESTINATION ${CMAKE_INSTALL_DATADIR}/icons/hicolor/scalable/apps
        COMPONENT runtime)
install(FILES ${SPLATVOL_PACKAGING}/splatvol-mime.xml DESTINATION ${CMAKE_INSTALL_DATADIR}/mime/packages
        RENAME splatvol.xml COMPONENT runtime)

set(SPLATVOL_MAINTAINER "The splatvol authors <splatvol@example.org>" CACHE STRING "Who answers for the packages")
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME splatvol)
set(CPACK_PACKAGE_VENDOR "The splatvol authors")
set(CPACK_PACKAGE_CONTACT ${SPLATVOL_MAINTAINER})
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ
    WORLD_EXECUTE)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL runtime library development)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS_POLICY ">=")
set(SPLATVOL_LIBRARY_PACKAGE libsplatvol${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})

set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME splatvol)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION science)
set(CPACK_COMPONENT_RUNTIME_DESCRIPTION "volume rendering of results on unstructured meshes, programs
Converts results of CFD and FEM on unstructured meshes, and scattered points,
to files that hold them from coarse to fine. Draws these as volumes, on a
graphics card or by the processor, from disk or over HTTP, also if they do
not fit in memory.")
# libcurl is loaded when a file has an address, OpenGL when it draws.
set(CPACK_DEBIAN_RUNTIME_PACKAGE_RECOMMENDS
    "ca-certificates, libcurl4, libegl1, libgl1, libegl-mesa0, libgl1-mesa-dri")
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SUGGESTS "ffmpeg, nginx, openssh-client, wl-clipboard, xclip")

set(CPACK_DEBIAN_LIBRARY_PACKAGE_NAME ${SPLATVOL_LIBRARY_PACKAGE})
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SECTION libs)
set(CPACK_COMPONENT_LIBRARY_DESCRIPTION "volume rendering of results on unstructured meshes, libraries
Libraries that build files of volumes from arrays in memory, read and draw
them.")
set(CPACK_DEBIAN_LIBRARY_PACKAGE_CONTROL_EXTRA ${SPLATVOL_PACKAGING}/debian/triggers)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_RECOMMENDS "ca-certificates, libcurl4")

set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libsplatvol-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION "volume rendering of results on unstructured meshes, headers
C++ headers and CMake files of the libraries that build, read and draw files
of volumes.")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS
    "${SPLATVOL_LIBRARY_PACKAGE} (= ${PROJECT_VERSION}), libexpected-dev, libglm-dev")

# Adds to each package what Debian's policy asks for.
set(CPACK_PRE_BUILD_SCRIPTS ${SPLATVOL_PACKAGING}/debian/finish.cmake)
set(CPACK_SPLATVOL_PACKAGING ${SPLATVOL_PACKAGING})
set(CPACK_SPLATVOL_MAINTAINER ${SPLATVOL_MAINTAINER})
set(CPACK_SPLATVOL_CHANGELOG ${PROJECT_SOURCE_DIR}/CHANGELOG.md)
include(CPack)
