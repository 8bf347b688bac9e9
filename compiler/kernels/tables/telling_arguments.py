"""Arguments at which the last digit of some constant of a kernel shows in its value.

Written by benchmarks/kernel_accuracy/choose_arguments.py, which says how they are chosen.
"""

from __future__ import annotations

from compiler.kernels.tables.formats import RealName

# of each kernel the arguments one after the other; those of two arguments come in pairs
HEXADECIMAL: dict[tuple[str, RealName], str] = {
    ("acos", "float"): (
        "0x1.8835a8p-2 0x1.99b198p-2 0x1.001ce4p-1 0x1.2a98dp-1 0x1.8099e6p-1 0x1.110b42p-26 "
        "0x1.110b46p-26"
    ),
    ("acos", "double"): (
        "0x1.3ade2564ed5fp-1 0x1.01c78b480c5c3p-2 0x1.bd45125213f8p-2 0x1.77624305b494p-1"
    ),
    ("asin", "float"): ("0x1.0087a2p-1 -0x1.d674bap-2 0x1.b6c46p-2 0x1.001efap-1 0x1.39f8aap-1"),
    ("asin", "double"): (
        "-0x1.2cd2378d1c63p-1 -0x1.4a81a57f010e5p-1 0x1.c55e878b73f9ap-2 0x1.ed303bd270f8p-2"
    ),
    ("atan", "float"): (
        "0x1.3f07f8p-2 0x1.6dba8ap-2 -0x1.3215e4p+1 -0x1.1b216cp+1 0x1.8570a4p+8 "
        "0x1.8fcbecp-1 0x1.bf7f9ap-1 0x1.526396p-1 -0x1.08da78p-1 -0x1.3p+0 0x1.4b6096p+7"
    ),
    ("atan", "double"): (
        "-0x1.8792bb60272p-2 -0x1.a6522a55c2e65p-2 0x1.be59a73b57591p+0 -0x1.14f4c8d9b91bfp-1 "
        "-0x1.5ffffffffffffp-1 -0x1.01875fc52b09ap+1 -0x1.6677a0e9f3ef7p+5 "
        "0x1.907f48b290659p-1 0x1.8b20c964fb68bp-1"
    ),
    ("atan2", "float"): (
        "-0x1.3f07fap-2 0x1.000002p+0 -0x1.6dba8cp-2 0x1.000002p+0 0x1.7d5c06p-3 "
        "-0x1.8aacep-4 0x1.04ad86p+1 -0x1.2cb2a4p+1 -0x1.2e798cp+2 -0x1.f82438p+0 -0x0p+0 "
        "-0x0p+0 -0x1p-149 0x0p+0 -0x1.000002p+1 -0x1.110b46p-25 -0x1.000002p+1 "
        "-0x1.110b48p-25 -inf inf -0x1.99ed52p+1 0x1.dadb8cp+1 0x1.47c60cp+1 0x1.e0c638p+1 "
        "-0x1.300002p+0 0x1.000002p+0 -0x1.110b46p-25 -0x1.000002p+0 -0x1.110b48p-25 "
        "-0x1.000002p+0 -0x1.fffffep+127 -inf -inf -0x1p-149 -inf -0x1.fffffep+127"
    ),
    ("atan2", "double"): (
        "-0x1.6p-1 0x1.0000000000001p+0 0x1.8e546002cc2cp+1 -0x1.3119903457268p+0 "
        "0x1.8c8f181c77acp-2 0x1.c0aa9843c58cp-3 -0x0p+0 -0x0p+0 -0x1.a005fb8b2b214p+1 "
        "0x1.755b95ba6b1bap+3 -0x0.0000000000001p-1022 0x0p+0 -0x1.4e2e4f5b5b1b4p+1 "
        "0x1.7d1630611396ap+1 -0x1.79cce97103c34p+0 0x1.13eb041754c3p+1 0x1.32dd18860632cp+1 "
        "-0x1.73c9f135ae3fbp+1 -0x1.3b0f198e08b6dp-4 0x1.ddda0dfcc38d5p-5 "
        "-0x1.fffffffffffffp+1023 -inf -inf -0x1.fffffffffffffp+1023 -inf "
        "-0x0.0000000000001p-1022 -inf inf 0x1.326443d6b53cbp-2 0x1.9320c0fd9893p-1"
    ),
    ("cos", "float"): (
        "0x1.06e994p+11 0x1.f75d7ap+23 0x1.4bde08p+9 -0x1.6e370ep+10 0x1.b93a16p+2 "
        "-0x1.c3cd86p+127 -0x1.0fd646p-1 -0x1.922002p+0 0x1.eb021cp+47 0x1.c61d4p+2 "
        "-0x1.fffffep+63 -0x1.fffffep+7 -0x1.fffffep+127 -0x1.fffffep+31 -0x1.fffffep+15 "
        "-0x1.fffffep+22 0x1.000002p-12 0x1.912c0cp-2 0x1.921fbap-1 0x1.fffffep+9 "
        "0x1.d2eb54p+10 0x1.889af2p+7 0x1.552e8ap+55 0x1.fffffep+11 0x1.c463aep+2 "
        "0x1.de0858p+9"
    ),
    ("cos", "double"): (
        "-0x1.c926877a2a587p+466 0x1.ea7ac50a83edap+909 0x1.00d9f0fe127afp+771 "
        "-0x1.fd7c9b3c2c1e5p+226 -0x1.367959a0e9d24p+352 -0x1.fffffffffffffp+127 "
        "-0x1.1170d8b78cfbcp+3 0x1.0a93730751f42p+862 -0x1.907b43c4030b8p+577 "
        "-0x1.921fb54442d19p+0 -0x1.fffffffffffffp+19 0x1.ae83980ea615cp+978 "
        "0x1.7f6114734465cp+977 -0x1.f7186ed7a5208p+371 -0x1.fffffffffffffp+255 "
        "-0x1.fffffffffffffp+511 -0x1.fffffffffffffp+63 -0x1.921fb54442d19p+10 "
        "-0x1.d7eceee54b5bfp+1021 -0x1.fffffffffffffp+31 -0x1.fffffffffffffp+15 "
        "0x1.6917cdc09eb0ap+10"
    ),
    ("cosh", "float"): (
        "0x1.456e32p-2 0x1.db63f8p-3 0x1.a5e85cp+5 0x1.4871f6p+6 0x1.03a30cp+5 -0x1.35f42cp+3 "
        "0x1.6dfb52p+3 0x1.7e9e06p+4"
    ),
    ("cosh", "double"): (
        "0x1.8b20257452549p+6 -0x1.bc7d706e654ap+0 0x1.6573c4209698p-2 -0x1.234a8cfc26127p+7 "
        "0x1.c436356953bcbp+8 0x1.2647ce1985af1p+8 -0x1.33c80c74e408fp+8 "
        "-0x1.54ccdc79eba15p+5 0x1.69041e870ffd7p+8 0x1.59e787a06114dp+6 0x1.5695fdc474daap+9 "
        "-0x1.caab0c97bca3ap+5 -0x1.cc4d2d4d5147ep+7 -0x1.f25fe809753d9p+6 "
        "0x1.08d63ecf23d4cp+9 -0x1.4dc1df3b4c0ep+9 0x1.502099736529ap+7 -0x1.5f3174a6d4107p+9 "
        "-0x1.e4abad5c7242bp+7 -0x1.36a465a4e2621p+9 0x1.7a9bcb1a5d148p+8 "
        "0x1.85d1806bd254fp+8 0x1.03754273117ap+9 0x1.9d2123ac90181p+7 0x1.2fa8755e05ef6p+9 "
        "-0x1.ca352b883443ap+8 0x1.498b36e833d01p+8 -0x1.150a5b56aeb4cp+9 "
        "-0x1.0d5cc2239b5fep+8 0x1.9a8571b910174p+8 -0x1.dc07e06decdbbp+8 "
        "-0x1.3e2e138426afbp+9 0x1.1c4533d7b39c4p+9 -0x1.8accdc9bc3013p+6 "
        "-0x1.4e2c437178ff9p+2 -0x1.ce6080e555f32p+2"
    ),
    ("exp", "float"): (
        "0x1.a8b404p-3 0x1.5cd5d2p-2 -0x1.349e8ep+6 0x1.4871f6p+6 0x1.1e9116p+6 0x1.03a30cp+5 "
        "-0x1.bc228p+5 -0x1.5b4b58p+6 -0x1.4d5e6ep+3 -0x1.9fe368p+6 0x1.62e43p-2 "
        "0x1.0a2b24p+0"
    ),
    ("exp", "double"): (
        "0x1.5695fdc474daap+9 0x1.47ea1a59aad5cp+2 0x1.62e42fefa39e7p+9 -0x1.234a8cfc26127p+7 "
        "0x1.c436356953bcbp+8 0x1.2647ce1985af1p+8 -0x1.33c80c74e408fp+8 "
        "-0x1.8accdc9bc3013p+6 -0x1.54ccdc79eba15p+5 0x1.69041e870ffd7p+8 "
        "0x1.59e787a06114dp+6 0x1.23a4e877d4763p+6 -0x1.cc4d2d4d5147ep+7 0x1.08d63ecf23d4cp+9 "
        "-0x1.4dc1df3b4c0ep+9 0x1.01e3922ffd8b6p+7 -0x1.37cc2d72f4f94p+6 0x1.502099736529ap+7 "
        "0x1.dae33504254bap+6 0x1.3d1b6e535e9fcp+8 -0x1.3ccf1a34e28fp+7 -0x1.047b4c8e149abp+9 "
        "-0x1.5f3174a6d4107p+9 -0x1.b7211387ab6cp+8 -0x1.a06fceb9a1e83p+6 "
        "-0x1.e4abad5c7242bp+7 -0x1.1d0f606ef1d79p+8 0x1.107c2e181eda4p+5 "
        "-0x1.36a465a4e2621p+9 0x1.7a9bcb1a5d148p+8 0x1.85d1806bd254fp+8 0x1.e8bc1a23ff0a6p+7 "
        "-0x1.5db760409a33ap+8 0x1.9d2123ac90181p+7 0x1.2fa8755e05ef6p+9 "
        "-0x1.ca352b883443ap+8 0x1.b097475b91b2ap+7 -0x1.81ebcb56b9bb4p+8 "
        "0x1.2fba2a3aa0d7fp+7 0x1.498b36e833d01p+8 0x1.36c853c39e2a3p+9 -0x1.150a5b56aeb4cp+9 "
        "0x1.015d4f1742172p+9 -0x1.5854d4fb42da2p+7 -0x1.0d5cc2239b5fep+8 "
        "0x1.9a8571b910174p+8 -0x1.81baf5ef213cp+7 -0x1.52a63867228b4p+8 "
        "-0x1.94db6a8e47756p+8 -0x1.a819b4617f3d7p+8 -0x1.f3732fc0d3d91p+8 "
        "-0x1.07f7c87c97c3bp+9 -0x1.20924b8efd366p+9 -0x1.29c0e3157e8e2p+9 "
        "-0x1.3e2e138426afbp+9 -0x1.5804288faefaep+9 0x1.0ae65c68f62b4p+8 "
        "0x1.d889a5c378b5cp+8 0x1.e3f9856428331p+8 0x1.147e58a2aab3ep+9 0x1.1c4533d7b39c4p+9 "
        "0x1.3dab25275439ep+9 0x1.4814dde12494bp+9 -0x1.c882a3f81c179p-3 "
        "-0x1.d61653c879688p+0 -0x1.74910d52d3051p+9 -0x1.74910d52d3052p+9 "
        "0x1.62e42fefa39e8p+9"
    ),
    ("log", "float"): (
        "0x1p+0 0x1.7b4886p-22 0x1.7494aep-80 0x1.c3cep-133 0x1.08d1f4p+4 0x1.0d7f58p+2 "
        "0x1.6e13ep+0 0x1.491ac4p+1 0x1.3cfb18p+16 0x1.319aep+8 0x1.b94644p+8 0x1.1693ap+106 "
        "0x1p-149 0x1.6a09e6p+0 0x1p+64 0x1.fffffep+127 0x1p+32"
    ),
    ("log", "double"): (
        "0x1p+0 0x1.6f6db32fe2cdp+2 0x1.6a09e667f3bcep+0 0x1.6ff9c0539c0c4p+3 "
        "0x1.549f1e6ac0ee9p+1 0x1p+64 0x1p+128 0x1p+32 0x1p+16 0x1.21296815689bdp+8 "
        "0x1.5684e6fcda6c3p+2 0x1.42edec81c4101p+4 0x1.26dac29c50527p+0 "
        "0x1.a5ea3fc026dfdp+557 0x1.12d3e9f936bb8p-929 0x1.529f639fcbb45p-647 0x1p+256 "
        "0x1p+512 0x1.dd913d033c443p+797 0x1.fffffffffffffp+1023 0x0.0000000000001p-1022"
    ),
    ("pow", "float"): (
        "0x1.544d2p-130 0x1.cbd656p-1 0x1.410d3ep-126 -0x1.e7d6c8p-2 0x1.7b8a22p-77 "
        "-0x1.131eecp-2 -0x1.6a09e8p+0 -0x1.54p+6 0x1.7f3bfcp-127 -0x1.cd4c7p-1 "
        "-0x1.000002p+64 -0x1p+1 -0x1.fffffep+23 -0x1.8p+1 0x1.563a8ap+11 0x1.de0c96p+2 "
        "0x1.58560ap+5 -0x1.67491p+2 0x1.4b32d4p+1 -0x1.6c9dfap+0 0x0p+0 0x0p+0 -0x0p+0 "
        "-0x1.fffffep+23 -0x1.fffffep+127 -0x1p-149 -inf 0x1p-149 0x0p+0 -0x1.62e402p-1 "
        "0x1p+0 nan 0x1.82056p-130 -0x1.47c396p-4 0x1.6ed27ap-126 -0x1.0c0c6p-2 0x1.2c660ap+2 "
        "0x1.840e2ap-1 0x1.59426ap+8 -0x1.5672f2p+1 0x1.3cfb18p+16 -0x1.da0ef8p+0 -0x1p-149 "
        "-0x1.fffffep+23 -0x1p-149 -0x1.000002p+16 -0x1.6a09e6p+0 0x1p+8 -0x1.fffffep+106 "
        "-0x1p+0 -0x1.000002p+4 -0x1p+5 -0x1.fffffep+127 -inf -0x1.fffffep+74 -0x1p+1 "
        "-0x1.000002p+32 -0x1p+2 -inf -0x1p-149 0x1.fffffep-1 -inf 0x1.000002p+0 -inf "
        "0x1p-149 0x1p-1 0x1.6a09e8p+0 -0x1.2f2066p+2 0x1.fffffep-86 0x1.000002p-1 "
        "0x1.036e08p-30 -0x1.fe2c86p+1"
    ),
    ("pow", "double"): (
        "-0x1.5555555555556p-1 0x1p+9 -0x1.fffffffffffffp-513 -0x1p+0 0x1.39e20c8810f98p+2 "
        "0x1.bb50162eaffb5p+8 0x1.1373e6fea4e0dp+1 -0x1.be254ed7d6ed7p+5 0x1.2647ce1985af1p+8 "
        "0x1.16db0bf4a95ecp+1 -0x1.fffffffffffffp+511 -0x1p+0 -0x1.0000000000001p+512 -0x1p+1 "
        "-0x1.0000000000001p+64 0x1p+0 -0x1.fffffffffffffp+0 -0x1.19p+9 "
        "-0x1.0000000000001p+128 0x1p+0 0x1.6cf40b5730f89p-4 -0x1.97bd09f2aa8d5p+6 "
        "0x1.0000000000001p-786 -0x1.2492492492363p-2 0x1.691dee8ff553dp+7 "
        "-0x1.0633d9f27ee3ep+6 0x1.2bac5aded2e3ep+33 -0x1.559f307aa8994p+1 "
        "-0x1.0000000000001p+256 0x1p+0 -0x1.0000002000001p+27 -0x1p+5 -0x1.8p+1 -0x1p+8 "
        "0x0.0000000000001p-1022 0x1.0000000000001p-2 0x1.2ebe59ca6f3a2p+3 "
        "-0x1.78e1c9608068bp+3 0x1.00174c1a42be2p+2 0x1.6539509997cb8p+8 0x1.2dc101fe0032cp+3 "
        "0x1.2d3efb2ca3defp+8 0x1.3f5cb47f9270cp+2 -0x1.e2938f9044922p+5 0x1.1bef4e8f237ebp+3 "
        "-0x1.258904079e509p+7 0x1.ba9547f31b6e5p+1 -0x1.78b5331523324p+7 "
        "0x1.040a4d48e8271p+3 -0x1.1fc320502d92cp+6 0x1.23fd70fa62912p+2 0x1.54569d7908decp+7 "
        "0x1.2bbcd071ffb5dp+1 -0x1.12ceaeae2ae9ap+7 0x1.388aa30cf02e1p+2 0x1.18b0e25705733p+7 "
        "0x1.18916d0f44355p+3 0x1.5a85262fcdb15p+7 0x1.24e645bd0ac2ap+1 0x1.71e1c2e7b551dp+8 "
        "0x1.c436356953bcbp+8 0x1.6ed223d998e5ap+6 0x1.37fb02f51381p+2 0x1.6fc570dd41adfp+5 "
        "0x1.b0cc38bc6fa25p-20 -0x1.fbdd33e1e1a83p+2 0x1.704b407cf282cp+10 "
        "0x1.d09b3dc0ba224p+5 0x1.36d8d79eb4196p+10 -0x1.3275c6283d49ep+6 "
        "0x1.42adb3b9998c3p-455 0x1.db33445077af8p+0 0x1.1d9d1e9a3d8dp+217 "
        "0x1.1f046cb1d513bp+1 0x1.f722ddd84c387p-449 0x1.05761499b744cp+1 "
        "0x1.aa9abbe16ccefp-165 -0x1.3a26919c88ae8p+1 0x1.dbfcf3c812b4dp+412 "
        "0x1.6a996bb4f430fp+0 0x1.934840ecdbd8ep-891 -0x1.7c7d37fd9fd71p-1 "
        "0x1.1daa6101e75d2p+459 0x1.9c932326eb09ep+0 0x1.d749936936d38p+201 "
        "-0x1.efdccb760127dp+0 0x1.e4b629c2ebcafp-464 0x1.70d42388d5bap+0 "
        "0x1.dfa6b1f058754p-429 -0x1.79892d08953afp+0 0x1.6e916479e7d8cp-738 "
        "0x1.013900d094284p+0 0x1.ec395f1268c65p+444 0x1.b8add6bd50538p+0 "
        "0x1.ea1755805a3ddp-571 0x1.d8421bb2a9e08p+0 0x1.11390748b49dp-87 "
        "0x1.1f395b15a0498p+1 0x1.cefd4a1ef5898p+737 0x1.19ed3ff8dbf2p-2 "
        "0x1.f4e70793e5df3p+254 0x1.a586f66e0c98cp+1 0x1.8a571be9b8703p+477 "
        "-0x1.3f0ddee0c9f71p+0 0x1.2c0b610782a1cp+957 0x1.f24dd75ca3e8p-1 "
        "0x1.b9e6b5826a177p+536 0x1.9486edf2f8024p+0 0x1.93991ff05f747p-463 "
        "0x1.01b63d2034db3p+1 0x1.22764921cccd4p+630 -0x1.1f7ba494d5ccap+0 "
        "0x1.b1821496e1fc3p+253 -0x1.7ef5f646396cap+1 0x1.0ad74f7b76707p+482 "
        "0x1.321a475e5743p-1 0x0p+0 0x0p+0 -0x0p+0 -0x1.fffffffffffffp+52 "
        "-0x1.0000000000001p+366 -0x1p+0 -0x1.0000000000001p+974 -0x1p+0 "
        "-0x1.0000000000001p+622 -0x1p+0 -0x1.fffffffffffffp+1023 -0x0.0000000000001p-1022 "
        "-0x1.0000000000001p+878 0x1p+0 -0x1.0000000000001p+942 0x1p+0 "
        "-0x1.0000000000001p+494 -0x1p+1 -0x1.0000000000001p+654 -0x1p+0 -inf "
        "0x0.0000000000001p-1022 0x0p+0 -0x1.62e42fefa3801p-1 0x1.000000000000bp-1 "
        "0x1.71547652b82fep+0 0x1p+0 nan 0x1.340525fb5fb0fp+4 0x1.2b7f78357c92fp-2 "
        "-0x1.6a09e667f3bcdp+0 -0x1.0ccp+10 -0x1.fffffffffffffp+1023 -inf "
        "-0x1.0000000000001p+32 -0x1p+5 -0x0.0000000000001p-1022 -0x1.0000000000001p+46 "
        "-0x0.0000000000001p-1022 -0x1.fffffffffffffp+52 -0x1.0000000000001p+16 -0x1p+0 -inf "
        "-0x0.0000000000001p-1022 0x1.5a47955ee8bd2p-11 -0x1.2c1b00d0aa528p+2 "
        "0x1.fffffffffffffp-2 0x1.0cbffffffffffp+10 0x1.fffffffffffffp-1 -inf "
        "0x1.0000000000001p+0 -inf 0x1.fffffffffffffp-1011 -0x1p-2"
    ),
    ("sigmoid", "float"): (
        "-0x1.38ec62p+5 0x1.3c57e8p-2 -0x1.3b1da6p+4 -0x1.640356p-6 -0x1.5453dp+3 "
        "-0x1.349e8ep+6 -0x1.5b4b58p+6 -0x1.64a06ep-1 -0x1.04bed2p+4 -0x1.0a2c6cp+1 "
        "-0x1.472a5cp+4 -0x1.7e029p+4 -0x1.b8cd22p+1 -0x1.e7f9c2p+1 -0x1.ed8552p+4 "
        "-0x1.191a32p+3 -0x1.42135p+6 0x1.8aa3d8p-2"
    ),
    ("sigmoid", "double"): (
        "-0x1.b6aebdebd9dafp+7 -0x1.7a3bdc083867dp+6 -0x1.78b1598b87359p+2 "
        "-0x1.0457516277926p+4 -0x1.234a8cfc26127p+7 -0x1.33c80c74e408fp+8 "
        "-0x1.54ccdc79eba15p+5 -0x1.4dc1df3b4c0ep+9 -0x1.37cc2d72f4f94p+6 "
        "-0x1.3ccf1a34e28fp+7 -0x1.047b4c8e149abp+9 -0x1.5f3174a6d4107p+9 "
        "-0x1.b7211387ab6cp+8 -0x1.a06fceb9a1e83p+6 -0x1.e4abad5c7242bp+7 "
        "-0x1.1d0f606ef1d79p+8 -0x1.36a465a4e2621p+9 -0x1.5db760409a33ap+8 "
        "-0x1.ca352b883443ap+8 -0x1.81ebcb56b9bb4p+8 -0x1.150a5b56aeb4cp+9 "
        "-0x1.5854d4fb42da2p+7 -0x1.0d5cc2239b5fep+8 -0x1.81baf5ef213cp+7 "
        "-0x1.52a63867228b4p+8 -0x1.94db6a8e47756p+8 -0x1.a819b4617f3d7p+8 "
        "-0x1.f3732fc0d3d91p+8 -0x1.07f7c87c97c3bp+9 -0x1.20924b8efd366p+9 "
        "-0x1.29c0e3157e8e2p+9 -0x1.3e2e138426afbp+9 -0x1.5804288faefaep+9 "
        "-0x1.9564e80b6706p+0 -0x1.91e762faf7341p-2 -0x1.74910d52d3051p+9 "
        "-0x1.15d4415a64c5p+3"
    ),
    ("sin", "float"): (
        "0x1.7a70aep+24 0x1.798a3ep+19 -0x1.b86068p+109 0x1.9c6096p-1 0x1.69e0c2p+34 "
        "-0x1.921fb4p+7 -0x1.ebae64p+1 0x1.675c48p+126 0x1.2e697ep+28 0x1.712e48p+35 "
        "0x1.adb598p+12 0x1.163e42p+3 -0x1.fffffep+63 -0x1.fffffep+7 -0x1.fffffep+127 "
        "-0x1.fffffep+31 -0x1.fffffep+15 -0x1.fffffep+22 0x1.921fb6p-1 0x1.fffffep+9 "
        "0x1.fffffep+11 0x1.19db64p+26 0x1.82558ap+9 0x1.1475cep+3"
    ),
    ("sin", "double"): (
        "-0x1.921fb54442d19p+10 -0x1.2a22173dbfe3ep+532 -0x1.28bef9e0fdbf2p+403 "
        "0x1.7aff347d26d9ap+244 -0x1.690f1f67f6e5ep+922 0x1.639968ba9d343p+816 "
        "-0x1.c0cb98a98b4e8p+325 -0x1.921fb54442d17p+10 0x1.c9e43c88185cep+107 "
        "0x1.c53a977e12748p+2 0x1.7e4bdf94f8ac5p+722 -0x1.c5fa6f61dc10fp+507 "
        "-0x1.fffffffffffffp+255 -0x1.fffffffffffffp+511 -0x1.fffffffffffffp+63 "
        "-0x1.fffffffffffffp+19 -0x1.921fb54442d18p+10 -0x1.fffffffffffffp+127 "
        "-0x1.fffffffffffffp+31 -0x1.fffffffffffffp+15 0x1.c1e53ac13a3c8p+2 "
        "0x1.d575013dcf0acp+1022"
    ),
    ("sinh", "float"): (
        "0x1.13a416p+0 0x1.16423cp+0 0x1.81c26ap-1 0x1.b4b63ap-1 -0x1.32c96p+6 0x1.a5e85cp+5 "
        "0x1.03a30cp+5 -0x1.fffffep-1 0x1.9a57d8p+3 0x1.7e9e06p+4"
    ),
    ("sinh", "double"): (
        "-0x1.6d2cdfe885f18p+3 -0x1.a2bea326172d8p+2 -0x1.4e508a16596ep-1 "
        "-0x1.bd43d7c6ec0d7p-1 0x1.b117da5837308p+1 -0x1.234a8cfc26127p+7 "
        "0x1.c436356953bcbp+8 0x1.2647ce1985af1p+8 -0x1.33c80c74e408fp+8 "
        "-0x1.8accdc9bc3013p+6 -0x1.54ccdc79eba15p+5 0x1.69041e870ffd7p+8 "
        "0x1.59e787a06114dp+6 0x1.5695fdc474daap+9 -0x1.caab0c97bca3ap+5 "
        "-0x1.cc4d2d4d5147ep+7 -0x1.f25fe809753d9p+6 0x1.08d63ecf23d4cp+9 "
        "-0x1.4dc1df3b4c0ep+9 0x1.502099736529ap+7 -0x1.5f3174a6d4107p+9 "
        "-0x1.e4abad5c7242bp+7 -0x1.36a465a4e2621p+9 0x1.7a9bcb1a5d148p+8 "
        "0x1.85d1806bd254fp+8 0x1.03754273117ap+9 0x1.9d2123ac90181p+7 0x1.2fa8755e05ef6p+9 "
        "-0x1.ca352b883443ap+8 0x1.498b36e833d01p+8 -0x1.150a5b56aeb4cp+9 "
        "-0x1.0d5cc2239b5fep+8 0x1.9a8571b910174p+8 -0x1.dc07e06decdbbp+8 "
        "-0x1.3e2e138426afbp+9 0x1.1c4533d7b39c4p+9 0x1.7a0a218121364p+1"
    ),
    ("softplus", "float"): (
        "0x1.d0bb66p-3 -0x1.5d0332p-5 -0x1.38ec62p+5 -0x1.3b1da6p+4 -0x1.576f7p+3 "
        "-0x1.349e8ep+6 0x1.bb6354p-2 0x1.16bf1ep+0 -0x1.5b4b58p+6 -0x1.d1fbc2p-2 "
        "-0x1.632feep+0 -0x1.094c6ap+1 -0x1.472a5cp+4 -0x1.7e029p+4 -0x1.ed8552p+4 "
        "-0x1.42135p+6 0x1.4ab772p-3 0x1.62e432p-2 0x1.28291cp+0"
    ),
    ("softplus", "double"): (
        "-0x1.b6aebdebd9dafp+7 -0x1.007f13156489p+0 -0x1.7a3bdc083867dp+6 0x1.c058f2b91f24p-1 "
        "-0x1.234a8cfc26127p+7 -0x1.33c80c74e408fp+8 -0x1.54ccdc79eba15p+5 "
        "-0x1.fffd87ee3b7fp-2 -0x1.4dc1df3b4c0ep+9 -0x1.37cc2d72f4f94p+6 -0x1.3ccf1a34e28fp+7 "
        "-0x1.047b4c8e149abp+9 -0x1.5f3174a6d4107p+9 -0x1.b7211387ab6cp+8 "
        "-0x1.a06fceb9a1e83p+6 -0x1.e4abad5c7242bp+7 -0x1.1d0f606ef1d79p+8 "
        "-0x1.36a465a4e2621p+9 -0x1.5db760409a33ap+8 -0x1.ca352b883443ap+8 "
        "-0x1.81ebcb56b9bb4p+8 -0x1.150a5b56aeb4cp+9 -0x1.5854d4fb42da2p+7 "
        "-0x1.0d5cc2239b5fep+8 -0x1.81baf5ef213cp+7 -0x1.0b495cdaceddp+0 "
        "-0x1.6adba59fa4cd8p+3 -0x1.52a63867228b4p+8 -0x1.94db6a8e47756p+8 "
        "-0x1.a819b4617f3d7p+8 -0x1.f3732fc0d3d91p+8 -0x1.07f7c87c97c3bp+9 "
        "-0x1.20924b8efd366p+9 -0x1.29c0e3157e8e2p+9 -0x1.3e2e138426afbp+9 "
        "-0x1.5804288faefaep+9 -0x1.21c434177dfb6p+2 -0x1.74910d52d3051p+9 "
        "-0x1.2d7331fc98904p+3"
    ),
    ("tan", "float"): (
        "-0x1.c2698ep+19 -0x1.423714p-1 -0x1.c0272ep+31 -0x1.26ca36p-1 -0x1.228c38p+13 "
        "-0x1.c74dfcp-1 -0x1.c463acp+3 -0x1.101d2ep+1 -0x1.57853p-1 -0x1.a4b158p+7 "
        "-0x1.fffffep+63 -0x1.f3c214p+0 -0x1.fffffep+9 -0x1.b237ecp+3 -0x1.fffffep+7 "
        "-0x1.b9ab5ap+4 -0x1.26a3c4p+8 -0x1.fffffep+127 -0x1.fffffep+11 -0x1.fffffep+31 "
        "-0x1.a9adcep+18 -0x1.fffffep+15 -0x1.0887a6p+126 -0x1.fffffep+22 0x1.bd51bcp+49"
    ),
    ("tan", "double"): (
        "-0x1.921fb54442d19p+10 -0x1.345f45a9b3db5p+262 0x1.35a3aca3beff1p+455 "
        "-0x1.32d194660edcbp+909 -0x1.2de95f7d43171p+772 -0x1.18bb5082d418ep+3 "
        "-0x1.9516a5540c4ddp+374 -0x1.fffffffffffffp+511 -0x1.921fb54442d17p+10 "
        "0x1.1d9d1e9a3d8dp+217 -0x1.fffffffffffffp+255 -0x1.fffffffffffffp+63 "
        "-0x1.fffffffffffffp+19 -0x1.921fb54442d18p+10 -0x1.fffffffffffffp+127 "
        "-0x1.a413778daae2dp+11 -0x1.fffffffffffffp+31 -0x1.fffffffffffffp+15 "
        "0x1.65ffe04f5b028p+2 0x1.1c5269e02b5a2p+1023"
    ),
    ("tanh", "float"): (
        "-0x1.bb02e2p-1 0x1.af8c68p-1 0x1.3879a8p+0 0x1.d7be16p-1 -0x0p+0 -0x1.205966p+3 "
        "-0x1.205968p+3 0x1.1ce05cp+0 0x1.b97b64p+0"
    ),
    ("tanh", "double"): (
        "-0x1.7f8f4d7b861p-2 0x1.046a7f652d58p-1 0x1.1b628543eb0cp-1 0x1.48eec4f3749cp+0 "
        "-0x0p+0 -0x1.199999999999ap-1 -0x1.30fc1931f09c9p+4 -0x1.30fc1931f09cap+4"
    ),
}


def telling_arguments(kernel: str, real: RealName, arity: int) -> list[tuple[float, ...]]:
    """The arguments of a kernel, which takes `arity` of them, beside those of its branches."""
    if (kernel, real) not in HEXADECIMAL:
        message = f"run benchmarks/kernel_accuracy/choose_arguments.py {kernel}"
        raise KeyError(message)
    numbers = [float.fromhex(text) for text in HEXADECIMAL[kernel, real].split()]
    return [tuple(numbers[i : i + arity]) for i in range(0, len(numbers), arity)]
