"""The words for what a calibration holds: one table, from each thing to its spellings.

A key is split into words first (``leaves.words``), a name of a number is taken without underscores.
A spelling may stand in several rows: the form of the numbers then decides (``finder``).
"""

import re
from collections.abc import Iterable

ALIASES = {
    name: re.compile("|".join(spellings.split()).replace("*", r"\w*"))
    for name, spellings in {
        # a part of the rig
        "camera matrix": "k m a cm mtx intrinsic intrinsics intrinsicmatrix cameramatrix cammatrix",
        "distortion": "d kc coeffs? coefs? dist*",
        "rotation": "r rot* rmat rvec om rstereo stereor rodrigues",
        "quaternion": "q quat quaternion qvec xyzw wxyz",
        # whose order of turns differs between programs
        "angles": "euler rpy angles deg degrees roll pitch yaw",
        "translation": "t tran trans* tvec trns tstereo stereot",
        "place": "position pos xyz center centre place",
        "transform": "t rt trans* extrinsics? pose stereo",
        "transform from a camera": "sc bs wc bc ic",
        "projection": "p proj*",
        "size": "wh shape dimension dimensions imsize imgsize imagesize resolution size sz",
        "baseline": "baseline* stereobaseline",
        # what a part is of
        "both cameras": "stereo pair rig relative extrinsic extrinsics",
        "rectified images": "new optimal opt rectified undistorted ideal rect",
        # axes in which the poses of both cameras may be given
        "body": "world w map vehicle robot base rig body b imu i",
        # what stands on a vehicle beside its cameras
        "sensor": "imu gyro gyroscope accel accelerometer acc mag magnetometer compass ahrs ins mru"
        " gnss gps rtk antenna dvl adcp usbl sbl lbl aps acoustic modem transponder transducer"
        " receiver beacon hydrophone sonar multibeam mbes fls sss echosounder altimeter lidar laser"
        " radar depth pressure baro barometer ctd thruster arm gripper manipulator light lamp"
        " strobe flash led",
        # the target, its poses, the errors of the numbers
        "no part": "board boards chessboard checkerboard charuco aruco pattern square squares"
        " target grid marker markers views frames rvecs tvecs points corners roi imu std stds stdev"
        " error errors err covariance sigma uncertainty guess initial sensor pixel cell world map"
        " vehicle robot",
        # nothing without another word: the key above is asked
        "nothing": "matrix mat data values? val array vector cam camera coefficients parameters"
        " params rows? 0 1 2",
        # a key under which a camera's mapping says which one it is
        "name of a camera": "name id label side position location role which camera",
        # models of lenses, without underscores
        "fisheye": "fisheye equidistant kannalabrandt kannalabrandt8 kb4 opencvfisheye",
        "pinhole": "plumbbob rationalpolynomial radtan radialtangential brown brownconrady standard"
        " opencv",
        "other lens": "omni omnidirectional mei fov atan ds doublesphere eucm ucm division"
        " scaramuzza",
    }.items()
}
"""Thing -> its spellings; * stands for more letters."""


def words_for(said: Iterable[str], *things: str) -> set[str]:
    """The words among these that name one of the things."""
    return {word for word in said if any(ALIASES[thing].fullmatch(word) for thing in things)}


def _by_spelling(table: dict[str, str]) -> dict[str, str]:
    return {spelling: name for name, spellings in table.items() for spelling in spellings.split()}


SIDES = _by_spelling(
    {
        "left": "left l lft port master primary links gauche izquierda sinistra esquerda",
        "right": "right r rgt starboard stbd slave secondary rechts droite derecha destra direita",
        "0": "0 00",
        "1": "1 01",
        "2": "2 02",
    }
)
"""Word -> side of the rig, or the number of a camera."""
TWO_SIDES = {"lr": ("l", "r"), "rl": ("r", "l")}
"""Words of both sides: ``T_rl`` is ``T_right_left``."""
NUMBERS = _by_spelling(
    {
        "fx": "fx focalx focallengthx f focal focallength",
        "fy": "fy focaly focallengthy",
        "cx": "cx u0 ppx centerx principalpointx principlepointx principalptx",
        "cy": "cy v0 ppy centery principalpointy principlepointy principalpty",
        "skew": "skew",
    }
)
"""Name of one number, without underscores -> what it is."""
PAIRS = {
    "focal": ("fx", "fy"),
    "principal": ("cx", "cy"),
    "principle": ("cx", "cy"),
    "center": ("cx", "cy"),
    "tangential": ("p1", "p2"),
}
"""Part of the name of two numbers -> what they are: ``focal_length: [fx, fy]``."""
SHORT_PAIRS = {"f": "focal", "fc": "focal", "pp": "principal", "c": "principal", "cc": "principal"}
METERS = {
    spelling: meters
    for meters, spellings in {
        1.0: "m meter meters metres",
        1e-3: "mm millimeter millimeters millimetres",
        1e-2: "cm centimeter centimeters centimetres",
        0.0254: "in inch inches",
        0.3048: "ft foot feet",
    }.items()
    for spelling in spellings.split()
}
"""Unit of lengths -> meters."""
