"""A tyre property file of our own making, in SI and in millimetres, that tests share."""

TEXT = """\
[MDI_HEADER]
FILE_TYPE                = 'tir'
! A made-up tyre for tests
$--------------------------------------------------------------------units
[UNITS]
LENGTH                   = 'meter'
FORCE                    = 'newton'
ANGLE                    = 'radians'
MASS                     = 'kg'
TIME                     = 'second'
$----------------------------------------------------------------dimension
[DIMENSION]
UNLOADED_RADIUS          = 0.345         $Free radius
WIDTH                    = 0.225         $Section width
$---------------------------------------------------------------conditions
[OPERATING_CONDITIONS]
INFLPRES                 = 240000        $Inflation pressure
NOMPRES                  = 220000        $Nominal pressure
$------------------------------------------------------------------inertia
[INERTIA]
MASS                     = 10.1          $Mass of the tyre
IYY                      = 0.95          $About its axis
BELT_MASS                = 7.1           $Mass of the belt
BELT_IXX                 = 0.38          $About a diameter
BELT_IYY                 = 0.72          $About its axis
$---------------------------------------------------------------structural
[STRUCTURAL]
FREQ_LONG                = 75.5          $Hz
FREQ_YAW                 = 48.5          $Hz
FREQ_WINDUP              = 60.5          $Hz
DAMP_LONG                = 0.05
DAMP_YAW                 = 0.04
DAMP_WINDUP              = 0.06
"""

_IN_MM = {
    "LENGTH                   = 'meter'": "LENGTH                   = 'mm'",
    "= 0.345 ": "= 345   ",
    "= 0.225 ": "= 225   ",
    "= 240000": "= 0.24  ",
    "= 220000": "= 0.22  ",
    "= 0.95 ": "= 0.95e6 ",
    "= 0.38 ": "= 0.38e6 ",
    "= 0.72 ": "= 0.72e6 ",
}


def content(*, in_mm=False):
    """The file, with line ends of Windows."""
    text = TEXT
    for old, new in _IN_MM.items() if in_mm else ():
        assert old in text
        text = text.replace(old, new)
    return text.replace("\n", "\r\n").encode()
