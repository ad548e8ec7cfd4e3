# Installs links to the tools, for people who have no rosrun.
set(prefix "$ENV{DESTDIR}${CMAKE_INSTALL_PREFIX}")
file(MAKE_DIRECTORY "${prefix}/bin")
foreach(tool check_depth fuse_stack list_stack segment_depth)
  file(CREATE_LINK ../lib/all_in_focus/${tool} "${prefix}/bin/${tool}" SYMBOLIC)
endforeach()
