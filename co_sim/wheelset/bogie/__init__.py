"""The packaged example `wheelset run bogie`: two wheelset FMUs under a frame that PythonFMU3 exports."""
