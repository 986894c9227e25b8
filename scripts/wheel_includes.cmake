# Passed as CMAKE_PROJECT_INCLUDE when ft_manip_interfaces is built on the ROS wheels of PyPI.
# Their imported targets name the include folder of the machine that built the wheels
# (/opt/python/...), and cmake refuses targets with include folders that do not exist.

function(drop_missing_include_folders)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT folders)
      continue()
    endif()
    set(kept "")
    foreach(folder IN LISTS folders)
      if(EXISTS "${folder}" OR folder MATCHES "^\\$<")
        list(APPEND kept "${folder}")
      endif()
    endforeach()
    set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${kept}")
  endforeach()
endfunction()

cmake_language(DEFER CALL drop_missing_include_folders)
