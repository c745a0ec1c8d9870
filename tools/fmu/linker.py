"""The program that links an FMU, by a module that imports nothing: `vibrohil doctor` asks for it."""

LINKER = "gcc"
REMEDY = "install a C compiler: apt-get install gcc libc6-dev"
