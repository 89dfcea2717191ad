# Runs after the files of the packages have been gathered, and before they are packed: adds the licence and the changelog
# to each, and compresses manual pages.
cmake_minimum_required(VERSION 3.25)
foreach(component runtime library development)
  set(root ${CPACK_TEMPORARY_DIRECTORY}/${component})
  if(NOT IS_DIRECTORY ${root})
    continue()
  endif()
  string(TOUPPER ${component} upper)
  set(package ${CPACK_DEBIAN_${upper}_PACKAGE_NAME})
  set(documents ${root}/usr/share/doc/${package})
  file(MAKE_DIRECTORY ${documents})
  file(COPY_FILE ${CPACK_SPLATVOL_PACKAGING}/debian/copyright ${documents}/copyright)
  file(COPY_FILE ${CPACK_SPLATVOL_CHANGELOG} ${documents}/CHANGELOG.md)
  # The form that Debian's tools read; SOURCE_DATE_EPOCH sets the date.
  string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
  file(WRITE ${documents}/changelog "splatvol (${CPACK_PACKAGE_VERSION}) unstable; urgency=medium\n\n"
    "  * CHANGELOG.md.gz tells what changed.\n\n -- ${CPACK_SPLATVOL_MAINTAINER}  ${date}\n")
  file(GLOB pages ${root}/usr/share/man/man1/*.1)
  execute_process(COMMAND gzip -9nf ${documents}/changelog ${documents}/CHANGELOG.md ${pages} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
